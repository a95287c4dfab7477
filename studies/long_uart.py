"""None: it writes a UART stream of TI's out-of-box demo (SDK 3) of somebody who moves on the spot 2 m away, 16 points a frame.

    python3 studies/long_uart.py N_FRAMES STREAM
"""

import random
import struct
import sys

MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
N_POINTS = 16


def main():
    n_frames, name = int(sys.argv[1]), sys.argv[2]
    rng = random.Random(1)
    with open(name, "wb") as stream:
        for frame in range(n_frames):
            points = b"".join(
                struct.pack("<4f", rng.gauss(0, 0.1), 2 + rng.gauss(0, 0.1), rng.gauss(0, 0.4), rng.choice([0.1, -0.1, 0.2]))
                for _ in range(N_POINTS)
            )
            side = b"".join(struct.pack("<2h", rng.randrange(120, 250), 700) for _ in range(N_POINTS))
            body = struct.pack("<2I", 1, len(points)) + points + struct.pack("<2I", 7, len(side)) + side
            padding = -(40 + len(body)) % 32
            header = struct.pack("<8I", 0x03050004, 40 + len(body) + padding, 0xA6843, frame, 1000 * frame % 2**32, N_POINTS, 2, 0)
            stream.write(MAGIC + header + body + bytes(padding))


main()
