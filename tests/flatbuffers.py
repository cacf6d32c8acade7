"""Flatbuffers and AEDAT 4 files made by hand, field by field."""

import struct

from lookalikes import aedat4_packet

KINDS = {"<q": 8, "<i": 4, "<f": 4, "<h": 2, "<b": 1}


def row(fields):
    """A table with fields (struct format, value) or None: its bytes, with its layout first, and where it begins."""
    layout, body = [], b""
    for field in fields:
        layout.append(8 + len(body) if field else 0)
        if field:
            body += struct.pack(*field).ljust(8, b"\0")
    head = struct.pack(f"<HH{len(layout)}H", 4 + 2 * len(layout), 8 + len(body), *layout)
    head += bytes(-len(head) % 8)
    return head + struct.pack("<i4x", len(head)) + body, len(head)


def vector(name, tables):
    """A buffer, its length first, whose root has one field: a vector of tables as `row` gives them."""
    out = struct.pack("<I4s3H2xiII", 16, name, 6, 8, 4, 8, 4, len(tables))
    slots, bodies, at = b"", b"", 4 * len(tables)
    for number, (table, begin) in enumerate(tables):
        slots += struct.pack("<I", at + begin - 4 * number)
        bodies += table
        at += len(table)
    out += slots + bodies
    return struct.pack("<I", len(out)) + out


def frame(times, kind, width, height, place, pixels):
    """The content of a packet of a frame; fields that are None are left out."""
    numbers = [*(("<q", t) if t is not None else None for t in times), ("<b", kind)]
    table, begin = row([*numbers, *(("<h", n) for n in (width, height, *place)), ("<q", 0)])
    # the last field is the distance to the pixels, which follow
    table = table[:-8] + struct.pack("<I4xI", 8, len(pixels)) + pixels
    out = struct.pack("<I4s", 8 + begin, b"FRME") + table
    return struct.pack("<I", len(out)) + out


def inertial(samples):
    """The content of a packet of inertial samples (time, temperature, acceleration, rotation)."""
    return vector(b"IMUS", [row([("<q", t), *(("<f", value) for value in rest)]) for t, *rest in samples])


def triggers(signals):
    """The content of a packet of signals (time, type)."""
    return vector(b"TRIG", [row([("<q", t), ("<b", kind)]) for t, kind in signals])


def aedat4_file(packets, compression=0, table=None):
    """A file of packets (stream name, content) with streams EVTS, FRME, IMUS, TRIG and another, and no table.

    `table`: rows (first byte of the content, stream, size, number, first and last time) that it ends with.
    """
    names = ("EVTS", "FRME", "IMUS", "TRIG", "ELSE")
    nodes = "".join(f'<node name="{i}"><attr key="typeIdentifier">{name}</attr></node>' for i, name in enumerate(names))
    xml = f"<dv>{nodes}</dv>".encode()
    body = b"".join(aedat4_packet(names.index(name), content, compression) for name, content in packets)
    begin = 14 + 4 + 44 + len(xml) + 1
    header = struct.pack(
        "<I4s5H2xiiqII", 20, b"IOHE", 10, 20, 4, 8, 16, 12, compression, begin + len(body), 4, len(xml)
    )
    out = b"#!AER-DAT4.0\r\n" + struct.pack("<I", len(header) + len(xml) + 1) + header + xml + b"\0"
    assert len(out) == begin
    out += body
    if table is not None:
        rows = []
        for at, stream, size, *rest in table(begin) if callable(table) else table:
            fields = [("<q", at), ("<q", stream | size << 32), *(("<q", n) for n in rest)]
            rows.append(row(fields))
        content = vector(b"FTAB", rows)
        out += aedat4_packet(0, content, compression)[8:]
    return out
