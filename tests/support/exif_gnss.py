"""Gives JPEG files an EXIF block with a GNSS position and nothing else. Standard library only."""
import pathlib
import struct


def _rational(value, scale):
    return struct.pack("<II", round(value * scale), scale)


def _angle(value):
    degrees = int(abs(value))
    minutes = int((abs(value) - degrees) * 60)
    seconds = (abs(value) - degrees - minutes / 60) * 3600
    return _rational(degrees, 1) + _rational(minutes, 1) + _rational(seconds, 1_000_000)


def gnss_segment(latitude_deg, longitude_deg, altitude_m):
    """The APP1 segment: a TIFF header, IFD0 with a pointer to the GPS directory, and that directory (EXIF 2.3, 4.6.6)."""
    fields = [(1, 2, 2, b"N\0" if latitude_deg >= 0 else b"S\0"), (2, 5, 3, _angle(latitude_deg)), (3, 2, 2, b"E\0" if longitude_deg >= 0 else b"W\0"),
              (4, 5, 3, _angle(longitude_deg)), (5, 1, 1, b"\0"), (6, 5, 1, _rational(altitude_m, 1000))]
    gps_offset = 8 + 2 + 12 + 4
    data_offset = gps_offset + 2 + 12 * len(fields) + 4
    directory, data = struct.pack("<H", len(fields)), b""
    for tag, kind, count, value in fields:
        inline = value.ljust(4, b"\0") if len(value) <= 4 else struct.pack("<I", data_offset + len(data))
        directory += struct.pack("<HHI", tag, kind, count) + inline
        data += value if len(value) > 4 else b""
    tiff = b"II*\0" + struct.pack("<I", 8) + struct.pack("<HHHII", 1, 0x8825, 4, 1, gps_offset) + b"\0" * 4 + directory + b"\0" * 4 + data
    body = b"Exif\0\0" + tiff
    return b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body


def set_gnss(path, position):
    """Replaces the APP1 segments of a JPEG file; `position` is (latitude deg, longitude deg, altitude m), or None for no EXIF at all."""
    path = pathlib.Path(path)
    content = path.read_bytes()
    kept, at = b"", 2
    while content[at] == 0xFF and content[at + 1] != 0xDA:
        length = 2 + struct.unpack(">H", content[at + 2:at + 4])[0]
        if content[at + 1] != 0xE1:
            kept += content[at:at + length]
        at += length
    path.write_bytes(content[:2] + (gnss_segment(*position) if position else b"") + kept + content[at:])
