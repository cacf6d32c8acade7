"""A camera's stream as a recording: from the reset of its clock on, until it ends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from nvsdata.data.events import Events
from nvsdata.data.samples import Piece, within
from nvsdata.recording.davis.stream import Decoder

RESET, RISING, PULSE = 1, 2, 4  # special events


def decoded(decoder: Decoder, blocks: Iterable[bytes], last: int | None) -> Iterator[tuple[Piece, np.ndarray]]:
    """What blocks of whole words hold, and the times (µs, int64) of pulses and rising edges at the external input.

    Times count from the first reset of the camera's clock, and what came before it is left out; so is what comes
    from `last` (µs) on. However the blocks are cut, together they give the same. The decoder is a steady one.
    """
    begun = False
    size = (decoder.width, decoder.height)
    for block in blocks:
        events = decoder.feed(block)
        specials, samples, frames = decoder.specials, decoder.samples, decoder.frames
        kept, triggers = slice(None), (specials.kind == RISING) | (specials.kind == PULSE)
        if not begun:
            resets = np.flatnonzero(specials.kind == RESET)
            if not resets.size:
                continue
            begun, word = True, int(specials.word[resets[0]])
            kept = slice(int(specials.before[resets[0]]), None)
            triggers &= specials.word > word
            samples = samples.at(decoder.sample_words > word)
            frames = [frame for frame, at in zip(frames, decoder.frame_words, strict=True) if at > word]
        columns = events.columns.at(kept)
        times = specials.t[triggers]
        if last is not None:
            columns = columns.first(int(np.searchsorted(columns.t, last)))
            samples, times = samples.window(None, last), times[times < last]
            frames = list(within(frames, None, last))
        about = {"temperature": float(samples.temperature[-1])} if samples.t.size else {}
        end = decoder.now if last is None else min(decoder.now, last - 1)
        yield Piece.beside(Events.trusted(columns, size, 0, end), frames, samples, about), times
