"""Small PNG files by hand (PNG specification, third edition). Standard library only."""
import struct
import zlib

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, row, bits=8, colour=0, level=6):
    """The bytes of a PNG; row(y) gives the samples of a row as bytes. colour: 0 grey, 2 RGB, 6 RGBA."""
    packer = zlib.compressobj(level)
    data = b"".join(packer.compress(b"\0" + row(y)) for y in range(height)) + packer.flush()
    return SIGNATURE + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def png_size(content):
    """(width, height) of a whole PNG."""
    assert content[:8] == SIGNATURE and content[-8:-4] == b"IEND", "no PNG"
    return struct.unpack(">II", content[16:24])
