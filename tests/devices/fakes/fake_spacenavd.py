#!/usr/bin/env python3
"""spacenavd with a SpaceNavigator on it, protocol 0 or 1, as its public documentation describes it; written from that and
not from Palpate's client. Strict: what the real daemon would misread is written down as a violation.

    fake_spacenavd.py --socket PATH [--protocol 0|1] [--fault NAME@SECONDS]... [--log FILE]

From the connection on the puck is pushed right for 0.4 s, then let go (one zero, then nothing); then away and up for 0.4 s,
turned about the vertical; button 1 is pressed between the two. Faults: unplug (the device goes; version 1 says so), restart
(the daemon ends), noise (values within the dead zone), pieces (packets in parts), chatter (events between request and
answer), silent (a greeting that nobody answers, in version 1).
"""

import argparse
import json
import os
import socket
import struct
import sys
import threading
import time

TAG = 0x7FAA0000
NAME = b"SpaceNavigator of a fake that has a rather long name"


class Refused(Exception):
    """What no client may send."""


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--socket", required=True)
    parser.add_argument("--protocol", type=int, default=1)
    parser.add_argument("--fault", action="append", default=[])
    parser.add_argument("--log")
    options = parser.parse_args()
    faults = {name: float(at or 0) for name, _, at in (f.partition("@") for f in options.fault)}
    log = {"violations": [], "sensitivity": [], "requests": [], "events": 0, "last_force": [], "connections": 0}
    server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    server.bind(options.socket)
    server.listen(4)

    def packet(connection, *numbers):
        data = struct.pack("=8i", *numbers)
        log["events"] += numbers[0] < 10
        if "pieces" in faults:
            connection.sendall(data[:13])
            time.sleep(0.002)
            data = data[13:]
        connection.sendall(data)

    def motion(connection, values, since=16):
        packet(connection, 0, *values, since)

    def play(connection, lock):
        if options.protocol == 0 or "silent" in faults:  # such a daemon does not wait for a greeting, but the person does
            motion(connection, (0, 0, 0, 0, 0, 0))
            time.sleep(0.8)
        begin = time.monotonic()
        sent_button = released = False
        moving = True
        while True:
            time.sleep(0.016)
            t = time.monotonic() - begin
            with lock:
                if "unplug" in faults and t > faults["unplug"]:
                    if options.protocol == 1:
                        packet(connection, 3, 1, 0, 0x206, 0x46D, 0xC626, 0, 0)
                    return
                if "restart" in faults and t > faults["restart"]:
                    connection.shutdown(socket.SHUT_RDWR)
                    return
                if t < 0.4:
                    motion(connection, (250, 0, 0, 0, 0, 0))
                elif t < 0.5:
                    if moving:
                        motion(connection, (0, 0, 0, 0, 0, 0))
                    moving = False
                    if not sent_button:
                        packet(connection, 1, 0, 1, 0, 0, 0, 0, 0)
                    sent_button = True
                    if "noise" in faults:
                        motion(connection, (2, -2, 1, 0, 2, -1))
                elif t < 0.9:
                    if not released:
                        packet(connection, 2, 0, 0, 0, 0, 0, 0, 0)
                    released = True
                    motion(connection, (0, 250, 500, 0, 250, 0))
                    moving = True
                elif moving:
                    motion(connection, (0, 0, 0, 0, 0, 0))
                    moving = False

    def exactly(connection, size):
        data = b""
        while len(data) < size:
            more = connection.recv(size - len(data))
            if not more:
                raise EOFError
            data += more
        return data

    def greet(connection):
        """@returns the protocol that the client speaks from now on"""
        word = exactly(connection, 4)
        if options.protocol == 0 or "silent" in faults:
            log["sensitivity"].append(struct.unpack("=f", word)[0])
            while True:  # a client of version 0 sends sensitivities
                log["sensitivity"].append(struct.unpack("=f", exactly(connection, 4))[0])
                if not 0.01 < log["sensitivity"][-1] < 100:
                    raise Refused(f"a sensitivity of {log['sensitivity'][-1]}")
        number = struct.unpack("=I", word)[0]
        if number & 0xFFFF0000 != TAG or number & 0xFF00 != 0x5500:
            raise Refused(f"a greeting of {number:#x}")
        version = min(number & 0xFF, 1)
        connection.sendall(struct.pack("=I", TAG | 0x5500 | version))
        return version

    def answer(connection, lock, request):
        log["requests"].append(f"{request:#x}")
        if "chatter" in faults:
            motion(connection, (0, 0, 0, 0, 0, 0))
        kind = TAG | request
        with lock:
            if request == 0x2000:
                left, first = len(NAME), True
                while left > 0:
                    part = NAME[len(NAME) - left:][:24].ljust(24, b"\0")
                    connection.sendall(struct.pack("=i24si", kind, part, left | (0 if first else 0x10000)))
                    left, first = left - 24, False
            elif request == 0x2004:
                connection.sendall(struct.pack("=8i", kind, 0x46D, 0xC626, 0, 0, 0, 0, 0))
            elif request == 0x2003:
                connection.sendall(struct.pack("=8i", kind, 2, 0, 0, 0, 0, 0, 0))
            elif request in (0x1000, 0x1001, 0x1003, 0x2002, 0x2005):
                connection.sendall(struct.pack("=8i", kind, 6, 0, 0, 0, 0, 0, 0))
            else:
                connection.sendall(struct.pack("=8i", kind, 0, 0, 0, 0, 0, 0, -1))
                raise Refused(f"an unknown request {request:#x}")

    def serve(connection):
        lock = threading.Lock()
        log["connections"] += 1
        try:
            if options.protocol == 0 or "silent" in faults:
                threading.Thread(target=quietly, args=(play, connection, lock), daemon=True).start()
                greet(connection)
                return
            greet(connection)
            connection.settimeout(0.2)
            while True:  # the requests of the beginning; then the puck moves
                try:
                    kind, *_ = struct.unpack("=8i", exactly(connection, 32))
                except TimeoutError:
                    break
                if kind & 0xFFFF0000 != TAG:
                    raise Refused(f"a request of {kind:#x}")
                answer(connection, lock, kind & 0xFFFF)
            connection.settimeout(None)
            threading.Thread(target=quietly, args=(play, connection, lock), daemon=True).start()
            if connection.recv(1):
                raise Refused("something after the beginning")
        except Refused as error:
            log["violations"].append(str(error))
        except (OSError, EOFError):
            pass

    def quietly(what, *arguments):
        try:
            what(*arguments)
        except OSError:
            pass

    def accept():
        while True:
            connection, _ = server.accept()
            threading.Thread(target=serve, args=(connection,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    print(json.dumps({"socket": options.socket}), flush=True)
    sys.stdin.read()
    os.unlink(options.socket)
    if options.log:
        with open(options.log, "w", encoding="utf-8") as file:
            json.dump(log, file)


if __name__ == "__main__":
    main()
