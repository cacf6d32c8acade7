"""The `nvsdata record` command for one recording, and for diagnostics."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from nvsdata.common.errors import message_of, shown
from nvsdata.common.files import creating
from nvsdata.common.locks import check_place
from nvsdata.common.progress import bar as progress
from nvsdata.common.terminal import remark, say, tell
from nvsdata.data.events import Events
from nvsdata.recording.capture import RecordingReport, check_format, record, stopped_by_interrupt
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.diagnostics import examine
from nvsdata.recording.journal import check_finished, journal_of, left_over, left_over_message
from nvsdata.recording.live_view import LiveView
from nvsdata.recording.online_inference import OnlineInference
from nvsdata.recording.recorder import Recorder
from nvsdata.recording.simulated.options import Simulation

if TYPE_CHECKING:
    from nvsdata.models import OnlineClassifier


@dataclass(frozen=True)
class CameraChoice:
    """The camera that a command records with.

    Args:
        settings: Settings of the camera.
        serial: Serial number of the camera; None for the only camera that is connected.
        simulate: Record a simulated camera in place of a real one.
        note: Remark that is stored with each recording.
    """

    settings: CameraSettings
    serial: str | None = None
    simulate: Simulation | None = None
    note: str | None = None

    def find(self, backend: Any) -> Davis:
        """Open the camera through a backend of `Simulation`, or through pyusb's backend if `backend` is None."""
        camera = Davis.find(self.serial, backend=backend)
        camera.note = self.note
        return camera


def run_recording(
    out: Path | None,
    seconds: float | None,
    chosen: CameraChoice,
    *,
    live: bool,
    overwrite: bool,
    decider: OnlineClassifier | None = None,
    as_json: bool = False,
) -> int:
    """Record a camera and print a summary; return 0 if nothing was lost and all decisions were made, else 1.

    Args:
        out: The file; None if events are only shown or classified.
        seconds: Duration of the recording in s; None: until Ctrl-C, SIGTERM or SIGHUP.
        chosen: The camera.
        live: Show events in a window; closing it ends the recording.
        overwrite: Replace `out` if it exists.
        decider: Classifier of the events; each decision is printed as a line of JSON, and the summary goes to stderr.
        as_json: Print the report as a line of JSON.

    Raises:
        FileExistsError: `out` exists, and `overwrite` is false.
        OutputInUse: Another process records to `out`.
        ValueError: The camera has more pixels than the network takes, or the network classifies entire recordings.
    """
    backend, settings = chosen.simulate and chosen.simulate.alone(), chosen.settings
    if decider is not None:
        if decider.stream.window is None:
            raise ValueError(
                "the network was trained on whole recordings, but a camera's stream has no end: train it on windows"
            )
        remark("preparing the network")
        decider.prepare()
    with (
        _place(out, settings, overwrite),
        stopped_by_interrupt() as stop,
        chosen.find(backend) as camera,
    ):
        facts = camera.facts
        if decider is not None:
            _check_size((facts.width, facts.height), decider.sensor_size)
        until = "until Ctrl-C" if seconds is None else f"for {seconds:g} s"
        remark(f"{facts.name} {facts.serial}, {facts.width}x{facts.height}, {until}")
        inference = None if decider is None else _inference(decider, stop, alone=out is None and not live)
        with (
            inference or nullcontext(),
            progress(total=seconds, unit="s", bar_format="{desc}{bar:20}{r_bar}") as bar,
        ):

            def watch(report: RecordingReport, events: Events) -> None:
                if inference is not None:
                    inference.add(report, events)
                rate = report.events / report.seconds if report.seconds else 0
                bar.set_description_str(f"{report.events:,} events, {rate / 1e3:,.0f} k/s, ", refresh=False)
                bar.update(min(report.seconds, seconds or report.seconds) - bar.n)

            if live:
                report = _shown(camera, out, settings, seconds, stop, watch)
            else:
                report = record(camera, out, settings, seconds=seconds, stop=stop, watch=watch)
            bar.close()
            # printed before the last decisions, because the program that reads those may have ended
            if as_json and decider is None:
                figures = {k: v for k, v in asdict(report).items() if k != "triggers"}
                tell("", figures | {"whole": report.whole, "triggers": len(report.triggers)}, as_json=True)
            else:
                say(summary(report), sys.stderr if decider else sys.stdout)
    return 0 if report.whole and (inference is None or inference.error is None) else 1


def _inference(decider: OnlineClassifier, stop: Event, *, alone: bool) -> OnlineInference:
    """Return a thread that prints decisions as JSON; if it fails and nothing else is recorded (`alone`), set `stop`."""

    def ended(error: Exception) -> None:
        say(f"decisions ended early: {message_of(error) or type(error).__name__}")
        if alone:
            stop.set()

    return OnlineInference(decider, lambda line: print(json.dumps(line), flush=True), ended)


def _check_size(camera: tuple[int, int], network: tuple[int, int]) -> None:
    if camera[0] > network[0] or camera[1] > network[1]:
        raise ValueError("the camera has {}x{} pixels, but the network is for {}x{}".format(*camera, *network))


@contextmanager
def _place(out: Path | None, settings: CameraSettings, overwrite: bool) -> Iterator[None]:
    """Lock the file of a recording; delete or report files that killed processes left next to it."""
    if out is None:
        yield
        return
    if not check_format(out, settings) and settings.inertial:
        say(f"{out.suffix} files can't store inertial samples: they are left out")
    check_place(out)
    with creating(out, overwrite=overwrite):
        check_finished(out)
        for journal in left_over(out.parent):
            say(left_over_message(journal))
        try:
            yield
        except KeyboardInterrupt:
            if (left := journal_of(out)).exists():
                say(left_over_message(left))
            raise


def _shown(
    camera: Davis,
    out: Path | None,
    settings: CameraSettings,
    seconds: float | None,
    stop: Event,
    watch: Callable[[RecordingReport, Events], None],
) -> RecordingReport:
    """Record in another thread, and show events in this one."""
    with LiveView((camera.facts.width, camera.facts.height)) as window:

        def both(report: RecordingReport, events: Events) -> None:
            watch(report, events)
            window.add(events)

        recorder = Recorder(camera, out, settings, seconds=seconds, watch=both)
        recorder.start()
        try:
            while not (recorder.ended.wait(0.01) or window.closed or stop.is_set()):
                window.attend()
                window.draw()
        finally:
            report = recorder.finish()
    return report


def run_doctor(*, everything: bool, simulated: bool, as_json: bool, screen: bool, folder: Path | None) -> int:
    """Print the connected cameras, or all requirements of a recording; return 1 if a requirement is missing, else 0.

    Args:
        everything: Print all requirements of a recording, not only cameras.
        simulated: Look for a simulated camera.
        as_json: Print each finding as a line of JSON.
        screen: The recording shows windows or videos, so their requirements are needed.
        folder: Folder of the recording.
    """
    found = list(examine(Simulation().alone() if simulated else None, screen=screen, folder=folder))
    if not everything:
        found = [one for one in found if one.what == "camera" or (one.what == "libusb" and one.cure)]
    for one in found:
        optional = "" if one.needed or not one.cure else " (optional)"
        text = f"{one.what}: {shown(one.found)}{optional}" + (f"\n    {one.cure}" if one.cure else "")
        tell(text, one._asdict(), as_json=as_json)
    return 1 if any(one.missing for one in found) else 0


def summary(report: RecordingReport) -> str:
    """Return the report as text of a few lines, with all faults."""
    lines = [f"{shown(report.path or 'not kept')}: {report.events:,} events in {report.seconds:.2f} s; {report.ended}"]
    if report.frames:
        lines.append(f"{report.frames:,} frames")
    if report.lost:
        lines.append(f"{report.lost:,} bytes came faster than they could be decoded and written, and are lost")
    if report.dropped:
        lines.append(f"the camera dropped {report.dropped:,} events: reduce the event rate, or use a faster computer")
    wrong = {name: count for name, count in report.error_counts.items() if count}
    if wrong:
        lines.append("faults in the stream: " + ", ".join(f"{name} {count}" for name, count in wrong.items()))
    if report.temperature is not None:
        lines.append(f"the camera's temperature is {report.temperature:.1f} °C")
    return "\n".join(lines)


def settings_of(file: Path | None, biases: Sequence[str], **given: Any) -> CameraSettings:
    """Return the settings in a JSON file, changed by the other arguments.

    Args:
        file: The file; None for the defaults.
        biases: Biases as texts NAME=COARSE:FINE.
        given: Other settings by name; None leaves a setting unchanged.

    Raises:
        ValueError: The file or a bias can't be parsed.
    """
    settings = CameraSettings()
    if file is not None:
        try:
            read = json.loads(file.read_text())
            known = {field.name for field in fields(CameraSettings)}
            unknown = sorted(set(read) - known)
            if unknown:
                raise ValueError(f"no such setting: {', '.join(unknown)}; there are {', '.join(sorted(known))}")
            pairs = {name: (int(a), int(b)) for name, (a, b) in read.pop("biases", {}).items()}
            for name in ("region", "frame_region"):
                if read.get(name) is not None:
                    read[name] = tuple(read[name])
            masked = tuple(tuple(pixel) for pixel in read.pop("masked", ()))
            settings = CameraSettings(biases=pairs, masked=masked, **read)
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"{file}: {error}") from None
    numbers = dict(settings.biases)
    for text in biases:
        name, _, value = text.partition("=")
        first, _, second = value.partition(":")
        if not (name and first.isdigit() and second.isdigit()):
            raise ValueError(f"--bias takes NAME=COARSE:FINE, such as OnBn=5:255, not {text!r}")
        numbers[name] = int(first), int(second)
    return replace(settings, biases=numbers, **{name: value for name, value in given.items() if value is not None})
