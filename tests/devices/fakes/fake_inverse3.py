#!/usr/bin/env python3
"""The service of a Haply Inverse3, as its public pages describe it, with a device and a hand behind it.

Written from the documentation and not from Palpate's client. Strict: what the real service would refuse or leave aside is
written down as a violation, and it answers once for each message and never by itself. On one port it speaks HTTP and
WebSocket (JSON 3.x), on another the events.

    fake_inverse3.py [--version 3.5.0] [--spelling vector|values|both] [--fault NAME[@SECONDS]]... [--log FILE]

prints the ports as one line of JSON, runs until its standard input ends, and then writes its log.

Faults: no-device, no-power, uncalibrated, in-use, second (device), integers (numbers), unknown (fields), legacy; and, so
many seconds after the first force: taken, unplug (for good), replug (away for half a second, back under another id), late
(one answer, 150 ms), slow (all), twice, never, cut (a message), garbage, ebrake (for half a second), restart (closes the
connection once), events-end (closes the events' connection), jump (5 cm for good), nan.

A preset is of one connection and one device: with the next of either the origin is at the mounting plate again.
"""

import argparse
import base64
import hashlib
import json
import math
import os
import socket
import struct
import sys
import threading
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from hand import Hand  # noqa: E402

COMMANDS = {"set_cursor_force": None, "set_cursor_position": "position", "set_angular_torques": None,
            "set_angular_position": None, "set_transform": None, "probe_position": None, "probe_orientation": None}
CONFIGURE = {"preset", "basis", "mount", "filters", "gravity_compensation", "torque_scaling", "home_return"}
TOP = {"session", "inverse3", "verse_grip", "wireless_verse_grip", "custom_verse_grip"}


class Refused(Exception):
    """What no client may send."""


class Service:
    def __init__(self, options):
        self.options = options
        self.faults = {}
        for fault in options.fault:
            name, _, at = fault.partition("@")
            self.faults[name] = float(at) if at else 0.0
        self.lock = threading.Lock()
        self.hand = Hand(amplitude=options.amplitude, home=(0.0, -0.01, 0.02))
        self.force = [0.0, 0.0, 0.0]
        self.last_time = None
        self.first_force = None
        self.id, self.second_id = "049D", "04EA"
        self.preset, self.preset_of = "defaults", None
        self.done = set()
        self.events = []
        self.connections = []
        self.log = {"violations": [], "messages": 0, "forces": 0, "ignored_forces": 0, "spellings": [], "profile": None, "preset": None,
                    "max_force": 0.0, "largest_step": 0.0, "last_force": [0, 0, 0], "non_zero_while_away": 0, "connections": 0,
                    "first_force": None, "first_message_at": None, "closed_cleanly": 0, "uncentered_forces": 0, "history": []}

    # Faults

    def since(self):
        return -1.0 if self.first_force is None else time.monotonic() - self.first_force

    def on(self, name, length=math.inf):
        """The fault's time has come and its length [s] is not over."""
        return name in self.faults and self.first_force is not None and self.faults[name] <= self.since() < self.faults[name] + length

    def once(self, name):
        if name in self.done or not self.on(name):
            return False
        self.done.add(name)
        return True

    def present(self):
        if "no-device" in self.faults or self.on("unplug"):
            return False
        if self.on("replug"):
            self.id = "05FF"
            return self.since() > self.faults["replug"] + 0.5
        return True

    # The device

    def advance(self):
        now = time.monotonic()
        if not self.present():  # a device without power holds nothing
            self.force = self.log["last_force"] = [0.0, 0.0, 0.0]
        if self.last_time is not None:
            self.hand.advance(self.force if self.present() else [0, 0, 0], now - self.last_time)
        self.last_time = now

    def number(self, value):
        if "integers" in self.faults:
            return int(round(value)) if abs(value - round(value)) < 1e-12 else value
        return float(value)

    def vector(self, value):
        return {key: self.number(v) for key, v in zip("xyz", value)}

    def status(self):
        return {"calibrated": "uncalibrated" not in self.faults, "in_use": "in-use" in self.faults or self.on("taken"),
                "power_supply": "no-power" not in self.faults, "ready": True, "started": True}

    def state(self):
        position = list(self.hand.position)
        if self.preset_of != self.id:
            position = [position[0], position[1] - 0.12, position[2] + 0.1]
        if self.on("jump"):
            position[0] += 0.05
        new = self.newer()
        out = {"angular_position": {"a0": -30.93, "a1": 53.88, "a2": -6.64}, "angular_velocity": {"a0": 0, "a1": 0, "a2": 0},
               "body_orientation": {"w": 0.699, "x": 0.0015, "y": 0.715, "z": 0.0024},
               "control_domain": "cartesian" if new else "undefined", "control_mode": "idle",
               "current_angular_torques": {"a0": 0, "a1": 0, "a2": 0}, "current_cursor_force": self.vector(self.force),
               "current_cursor_position": self.vector(position), "cursor_position": self.vector(position),
               "cursor_velocity": self.vector(self.hand.velocity), "mode": "idle",
               "transform": {} if new else {"position": self.vector([0, 0, 0]), "rotation": {"w": 1, "x": 0, "y": 0, "z": 0},
                                            "scale": self.vector([1, 1, 1])}}
        if "integers" in self.faults:
            out["cursor_velocity"] = {"x": 0, "y": 0, "z": 0}
        if "unknown" in self.faults:
            out["weather"] = {"nice": [True, None, {"deep": "er"}]}
        if self.on("nan"):
            out["cursor_position"]["x"] = math.nan  # no JSON, but what a careless writer makes of it
        return out

    def newer(self):
        return tuple(map(int, self.options.version.split(".")[:2])) >= (3, 5)

    def config(self):
        return {"type": self.options.type, "port": "/dev/ttyACM0", "handedness": "right", "streaming_mode": "default",
                "device_info": {"major_version": 7, "minor_version": 1, "id": 1181, "device_type": 4, "uuid": "a-b-c"},
                "extended_device_id": "X" + self.id, "extended_firmware_version": "1.3.2", "preset": {"preset": self.preset},
                "basis": {"permutation": "XYZ"}, "mount": {"position": {}, "rotation": {}, "scale": {}},
                "gravity_compensation": {"enabled": True, "scaling_factor": 1.0}, "torque_scaling": {"enabled": True},
                "home_return": {"enabled": False}, "filters": {"force_gate": {"gain": 0.3}, "damping": {"scalar": 0}}}

    def answer(self, inventory=False):
        with self.lock:
            self.advance()
            devices = []
            if self.present():
                for name in [self.id] + ([self.second_id] if "second" in self.faults else []):
                    device = {"device_id": name, "state": self.state(), "status": self.status()}
                    if inventory:
                        device["config"] = self.config()
                    devices.append(device)
            grips = [{"device_id": "0A11", "state": {"button": False, "hall": 12,
                      "orientation": {"w": 1, "x": 0, "y": 0, "z": 0}, "transform": {}}}] if self.options.grip else []
            out = {"inverse3": devices, "verse_grip": grips, "wireless_verse_grip": []}
            if inventory:
                out = {"session_id": 7, **out}
            if "unknown" in self.faults:
                out["teapots"] = [1, 2]
            return json.dumps(out)

    # What a client sends

    def take(self, text, first):
        """Carries out one message. @returns whether the whole inventory was asked for"""
        now = time.monotonic()
        self.log["messages"] += 1
        if self.log["first_message_at"] is None:
            self.log["first_message_at"] = now

        def not_finite(word):
            raise Refused(f"{word} is no JSON")

        try:
            message = json.loads(text, parse_constant=not_finite)
        except json.JSONDecodeError as error:
            raise Refused(f"no JSON: {error}") from error
        if not isinstance(message, dict) or not set(message) <= TOP:
            raise Refused(f"unknown keys in {text[:80]}")
        full = False
        session = message.get("session", {})
        if not set(session) <= {"configure", "force_render_full_state"}:
            raise Refused(f"unknown keys of the session: {session}")
        if "configure" in session:
            if not first:
                raise Refused("session.configure after the first message")
            self.log["profile"] = session["configure"]["profile"]["name"]
        if "force_render_full_state" in session:
            full = True
        for device in message.get("inverse3", []):
            self.take_device(device, first)
        return full

    def take_device(self, device, first):
        if not set(device) <= {"device_id", "commands", "configure"}:
            raise Refused(f"unknown keys of a device: {sorted(device)}")
        known = [self.id] + ([self.second_id] if "second" in self.faults else [])
        here = self.present()
        if device.get("device_id") not in known and here:
            raise Refused(f"no device {device.get('device_id')!r}")
        configure = device.get("configure", {})
        if not set(configure) <= CONFIGURE:
            raise Refused(f"unknown configuration {sorted(configure)}")
        if "preset" in configure:
            if not first:
                raise Refused("a preset after the first message")
            self.preset = self.log["preset"] = configure["preset"]["preset"]
            self.preset_of = device["device_id"]
        for name, body in device.get("commands", {}).items():
            if name not in COMMANDS:
                raise Refused(f"unknown command {name}")
            if name == "set_cursor_force":
                self.take_force(body, here)

    def take_force(self, body, here):
        if len(body) != 1 or not set(body) <= {"vector", "values"}:
            raise Refused(f"a force with {sorted(body)}")
        (spelling, value), = body.items()
        if set(value) != {"x", "y", "z"} or not all(isinstance(v, (int, float)) and math.isfinite(v) for v in value.values()):
            raise Refused(f"a force of {value}")
        self.log["forces"] += 1
        if spelling not in self.log["spellings"]:
            self.log["spellings"].append(spelling)
        if self.options.spelling not in (spelling, "both"):
            self.log["ignored_forces"] += 1
            return
        force = [value["x"], value["y"], value["z"]]
        norm = math.hypot(*force)
        self.log["uncentered_forces"] += here and norm > 0.2 and self.preset_of != self.id
        if self.log["first_force"] is None and norm > 0:
            self.log["first_force"] = norm
        if norm > 0.2 and self.first_force is None:  # more than the gate's
            self.first_force = time.monotonic()
        with self.lock:
            self.advance()
            step = math.dist(force, self.force)
            self.force = force
        # a client cannot know at once
        braked = self.on("ebrake", 0.5) and self.since() > self.faults["ebrake"] + 0.03
        taken = self.on("taken") and self.since() > self.faults["taken"] + 0.03
        if not here or braked or taken:
            self.log["non_zero_while_away"] += norm > 0
        self.log["max_force"] = max(self.log["max_force"], norm)
        self.log["largest_step"] = max(self.log["largest_step"], step)
        self.log["last_force"] = force
        if len(self.log["history"]) < 200000:
            self.log["history"].append([round(self.since(), 5), *[round(f, 5) for f in force]])

    # Connections

    def listen(self, serve):
        server = socket.create_server(("127.0.0.1", 0))
        server.listen(8)

        def accept():
            while True:
                connection, _ = server.accept()
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self.guard, args=(serve, connection), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        return server.getsockname()[1]

    def guard(self, serve, connection):
        try:
            serve(connection)
        except (OSError, EOFError):
            pass
        except Refused as error:
            self.log["violations"].append(str(error))
        except Exception as error:  # noqa: BLE001  a bug of the fake must show
            self.log["violations"].append(f"fake: {error!r}")
        finally:
            connection.close()

    def greet(self, connection, stream):
        """HTTP until a WebSocket begins. @returns whether one did"""
        while True:
            request = stream.readline().decode()
            if not request:
                return False
            headers = {}
            while (line := stream.readline().decode().strip()):
                key, _, value = line.partition(":")
                headers[key.strip().lower()] = value.strip()
            if headers.get("upgrade", "").lower() == "websocket":
                if headers.get("sec-websocket-version") != "13" or "sec-websocket-key" not in headers:
                    raise Refused(f"no WebSocket handshake: {headers}")
                key = headers["sec-websocket-key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
                accept = base64.b64encode(hashlib.sha1(key.encode()).digest()).decode()
                connection.sendall((f"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                                    f"Sec-WebSocket-Accept: {accept}\r\n\r\n").encode())
                return True
            self.http(connection, request)

    def http(self, connection, request):
        method, path, *_ = request.split()
        path = path.partition("?")[0]
        status, body = 404, {"ok": False, "error": "not found"}
        if method == "GET" and "*" in path:
            status, body = 400, {"ok": False, "error": "wildcard"}
        elif (method, path) == ("GET", "/version"):
            status, body = 200, {"ok": True, "data": {"project_version": self.options.version}}
        elif (method, path) == ("GET", "/devices"):
            status, body = 200, {"ok": True, "data": [self.id]}
        text = json.dumps(body).encode()
        connection.sendall(f"HTTP/1.1 {status} X\r\nContent-Type: application/json\r\nContent-Length: {len(text)}\r\n\r\n".encode() + text)

    @staticmethod
    def receive(connection, stream):
        """The next text message, or None at the close."""
        head = stream.read(2)
        if len(head) < 2:
            raise EOFError
        final, opcode = head[0] & 0x80, head[0] & 0x0F
        if not head[1] & 0x80:
            raise Refused("a client's frame without a mask")
        size = head[1] & 127
        if size == 126:
            size = struct.unpack(">H", stream.read(2))[0]
        elif size == 127:
            size = struct.unpack(">Q", stream.read(8))[0]
        mask = stream.read(4)
        raw = stream.read(size)
        long_mask = (mask * (size // 4 + 1))[:size]
        payload = (int.from_bytes(raw, "big") ^ int.from_bytes(long_mask, "big")).to_bytes(size, "big") if size else b""
        if opcode == 8:
            connection.sendall(b"\x88" + bytes([len(payload)]) + payload)
            return None
        if opcode != 1 or not final:
            raise Refused(f"a frame of kind {opcode}, final {bool(final)}: one text frame a message")
        return payload.decode()

    @staticmethod
    def send(connection, text):
        payload = text.encode()
        size = len(payload)
        head = bytes([size]) if size < 126 else b"\x7e" + struct.pack(">H", size) if size < 65536 else b"\x7f" + struct.pack(">Q", size)
        connection.sendall(b"\x81" + head + payload)

    def serve(self, connection):
        stream = connection.makefile("rb")
        if not self.greet(connection, stream):
            return
        self.log["connections"] += 1
        self.connections.append(connection)
        self.preset, self.preset_of = "defaults", None
        self.send(connection, self.answer(inventory=True))
        first = True
        while True:
            text = self.receive(connection, stream)
            if text is None:
                self.log["closed_cleanly"] += 1
                return
            full = self.take(text, first)
            first = False
            if not self.reply(connection, full):
                return
            # a client that has not waited for its answer has already sent the next message
        return

    def reply(self, connection, full):
        if self.once("restart"):
            return False
        if self.on("never"):
            return True
        if self.once("late") or self.on("slow"):
            connection.setblocking(False)
            deadline = time.monotonic() + 0.15
            early = b""
            while time.monotonic() < deadline:
                try:
                    early = connection.recv(1, socket.MSG_PEEK)
                except BlockingIOError:
                    pass
                if early:
                    break
                time.sleep(0.005)
            connection.setblocking(True)
            if early:
                raise Refused("a second message before the answer to the first")
        answer = self.answer(inventory=full)
        if self.on("garbage"):
            answer = "[1, 2"
        if self.once("cut"):
            answer = answer[: len(answer) // 2]
        self.send(connection, answer)
        if self.once("twice"):
            self.send(connection, self.answer())
        return True

    def tell(self, connection):
        stream = connection.makefile("rb")
        if not self.greet(connection, stream):
            return
        told = set()

        def event(name, level, **data):
            self.send(connection, json.dumps({"name": name, "category": "device", "level": level,
                                              "data": {"device_family": "inverse", "device_id": self.id, **data}, "message": name}))

        while not self.on("events-end"):
            if self.on("ebrake") and "ebrake" not in told:
                told.add("ebrake")
                event("device-safety-triggered", "error", safety_type="ebrake_triggered")
            if self.on("ebrake") and not self.on("ebrake", 0.5) and "released" not in told:
                told.add("released")
                event("device-safety-triggered", "notice", safety_type="ebrake_released")
            if self.on("taken") and "taken" not in told:
                told.add("taken")
                event("device-busy", "warning")
            time.sleep(0.005)

    def legacy(self, connection):
        """Format 3.0: another shape, and it talks by itself."""
        stream = connection.makefile("rb")
        if self.greet(connection, stream):
            while True:
                self.send(connection, json.dumps({"devices": [{"id": self.id}]}))
                time.sleep(0.1)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--version", default="3.5.0")
    parser.add_argument("--spelling", default="vector", choices=("vector", "values", "both"))
    parser.add_argument("--fault", action="append", default=[])
    parser.add_argument("--type", default="inverse3")
    parser.add_argument("--grip", action="store_true")
    parser.add_argument("--amplitude", type=float, default=0.02)
    parser.add_argument("--log")
    options = parser.parse_args()
    service = Service(options)
    port = service.listen(service.legacy if "legacy" in service.faults else service.serve)
    events = service.listen(service.tell)
    print(json.dumps({"port": port, "events_port": events}), flush=True)
    sys.stdin.read()
    if options.log:
        with open(options.log, "w", encoding="utf-8") as file:
            json.dump(service.log, file)


if __name__ == "__main__":
    main()
