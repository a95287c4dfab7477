"""Checks what Home Assistant shows of `radarllm live sim:`; started by home-assistant-check.sh."""

import argparse
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request

ENTITIES = ("occupancy", "people", "activity", "fallen", "fall", "radar")
CONFIGURATION = """
homeassistant:
  name: Check
http:
  server_host: 127.0.0.1
  server_port: {port}
api:
config:
frontend:
logger:
  default: warning
"""


class Failed(Exception):
    """Something that must be so is not."""


def wait_for(what, check, seconds):
    """Waits until something is so; prints how long it took."""
    began = time.monotonic()
    while True:
        found = check()
        if found:
            print(f"ok   {what} ({time.monotonic() - began:.1f} s)", flush=True)
            return found
        if time.monotonic() - began > seconds:
            raise Failed(f"never came within {seconds} s: {what}")
        time.sleep(0.1)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Program:
    """A program that is stopped at the end."""

    def __init__(self, command, log):
        self.command, self.log = [str(part) for part in command], log
        self.start()

    def start(self):
        with open(self.log, "a") as log:
            self.process = subprocess.Popen(self.command, stdout=log, stderr=subprocess.STDOUT)

    def end(self, how=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(how)
            try:
                self.process.wait(60)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


class HomeAssistant:
    """The REST interface of Home Assistant, and all states that its entities have had."""

    def __init__(self, port):
        self.url, self.token, self.seen = f"http://127.0.0.1:{port}", None, {}

    def ask(self, path, body=None, form=None):
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        data = None
        if body is not None:
            headers["Content-Type"], data = "application/json", json.dumps(body).encode()
        if form is not None:
            data = urllib.parse.urlencode(form).encode()
        request = urllib.request.Request(self.url + path, data=data, headers=headers)
        with urllib.request.urlopen(request, timeout=30) as answer:
            text = answer.read()
            return json.loads(text) if text else None

    def is_up(self):
        try:
            return self.ask("/api/onboarding") is not None
        except (OSError, ValueError):
            return False

    def onboard(self):
        client = self.url + "/"
        made = self.ask("/api/onboarding/users", {
            "client_id": client, "name": "Check", "username": "check", "password": "check-only-here", "language": "en"})
        token = self.ask("/auth/token", form={
            "grant_type": "authorization_code", "code": made["auth_code"], "client_id": client})
        self.token, self.refresh, self.client = token["access_token"], token["refresh_token"], client

    def log_in_again(self):
        self.token = None
        token = self.ask("/auth/token", form={
            "grant_type": "refresh_token", "refresh_token": self.refresh, "client_id": self.client})
        self.token = token["access_token"]

    def add_mqtt(self, port):
        flow = self.ask("/api/config/config_entries/flow", {"handler": "mqtt"})
        done = self.ask(f"/api/config/config_entries/flow/{flow['flow_id']}", {"broker": "127.0.0.1", "port": port})
        if done["type"] != "create_entry":
            raise Failed(f"the MQTT integration is refused: {done}")

    def entities(self):
        """The six entities by their last word, and what is new about them remembered."""
        found = {}
        for state in self.ask("/api/states"):
            match = re.match(r"(binary_sensor|sensor|event)\.lounge_radar_simulated_(\w+)$", state["entity_id"])
            if match:
                found[match[2]] = state
                value = state["attributes"].get("event_type") if match[1] == "event" else state["state"]
                seen = self.seen.setdefault(match[2], [])
                if value is not None and (not seen or seen[-1] != value):
                    seen.append(value)
        return found

    def state(self, name):
        return self.entities().get(name, {}).get("state")

    def event(self):
        """The type of the last transition of a fall, and when it came."""
        fall = self.entities().get("fall", {})
        return fall.get("attributes", {}).get("event_type"), fall.get("state")


def falls(live_url):
    with urllib.request.urlopen(f"{live_url}/api/state", timeout=10) as answer:
        return json.load(answer)["falls"]


def acknowledge(live_url):
    for fall in falls(live_url):
        request = urllib.request.Request(f"{live_url}/api/falls/{fall['id']}/acknowledge", method="POST")
        urllib.request.urlopen(request, timeout=10).close()


def check(home, live, live_url, broker, hass):
    all_there = lambda: set(home.entities()) == set(ENTITIES)
    is_available = lambda: all_there() and all(e["state"] != "unavailable" for e in home.entities().values())
    is_unavailable = lambda: all(e["state"] == "unavailable" for e in home.entities().values())
    wait_for("six entities appear", all_there, 60)
    wait_for("they are available", is_available, 30)
    wait_for("the radar is connected", lambda: home.state("radar") == "on", 30)
    wait_for("somebody is there", lambda: home.state("occupancy") == "on" and home.state("people") == "1", 60)
    activity = wait_for("an activity is named", lambda: home.state("activity") not in ("nobody", "unsure", "unseen", None)
                        and home.entities()["activity"], 60)
    options = activity["attributes"]["options"]
    if activity["state"] not in options or not activity["attributes"]["caption"].strip():
        raise Failed(f"the activity has no sentence: {activity}")
    if activity["attributes"]["synthetic"] is not True:
        raise Failed(f"a simulated sentence is not marked: {activity}")
    print(f"     {activity['state']} of {len(options)} options, `{activity['attributes']['caption']}`")

    wait_for("a fall is suspected", lambda: home.event()[0] == "suspected", 120)
    # As a person would: when the fall is over.
    time.sleep(3)
    acknowledge(live_url)
    wait_for("acknowledged before it is confirmed, it is dismissed", lambda: home.event()[0] == "dismissed", 10)
    if home.state("fallen") != "off":
        raise Failed("`Fallen` is on after a dismissed fall")
    wait_for("the room becomes empty", lambda: home.state("occupancy") == "off" and home.state("people") == "0"
             and home.state("activity") == "nobody", 60)
    wait_for("a fall is suspected again", lambda: home.event()[0] == "suspected", 120)
    wait_for("it is confirmed", lambda: home.event()[0] == "confirmed", 30)
    wait_for("`Fallen` is on", lambda: home.state("fallen") == "on", 10)
    acknowledge(live_url)
    wait_for("acknowledged, it has recovered", lambda: home.event()[0] == "recovered", 10)
    wait_for("`Fallen` is off", lambda: home.state("fallen") == "off", 10)

    before = home.event()
    live.end(signal.SIGKILL)
    wait_for("after kill -9 of live everything is unavailable", is_unavailable, 15)
    live.start()
    wait_for("after its start everything is available", is_available, 60)
    if home.event() != before:
        raise Failed(f"an old fall was told again: {before}, {home.event()}")
    live.end(signal.SIGTERM)
    wait_for("after SIGTERM of live everything is unavailable", is_unavailable, 15)
    live.start()
    wait_for("after its start everything is available", is_available, 60)

    broker.end()
    wait_for("without the broker everything is unavailable", is_unavailable, 30)
    broker.start()
    wait_for("after its start everything is available", is_available, 90)

    hass.end()
    hass.start()
    wait_for("Home Assistant is back after a restart", home.is_up, 180)
    home.log_in_again()
    wait_for("everything is available again", is_available, 90)
    wait_for("somebody is there", lambda: home.state("occupancy") == "on", 120)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hass", required=True)
    parser.add_argument("--radarllm", required=True)
    arguments = parser.parse_args()
    mosquitto = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
    version = subprocess.run([arguments.hass, "--version"], capture_output=True, text=True).stdout.strip()
    broker_version = subprocess.run([mosquitto, "-h"], capture_output=True, text=True).stdout.split("\n")[0]
    print(f"Home Assistant {version}, Python {sys.version.split()[0]}, {broker_version}", flush=True)
    ports = {name: free_port() for name in ("broker", "home", "page")}
    live_url = f"http://127.0.0.1:{ports['page']}"
    programs = []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "configuration.yaml").write_text(CONFIGURATION.format(port=ports["home"]))
        try:
            broker = Program([mosquitto, "-p", ports["broker"]], folder / "mosquitto.log")
            programs.append(broker)
            hass = Program([arguments.hass, "-c", folder, "--skip-pip"], folder / "hass.log")
            programs.append(hass)
            home = HomeAssistant(ports["home"])
            wait_for("Home Assistant answers", home.is_up, 300)
            home.onboard()
            home.add_mqtt(ports["broker"])
            live = Program([
                arguments.radarllm, "live", "sim:", "--name", "lounge", "--http", f"127.0.0.1:{ports['page']}",
                "--mqtt", f"mqtt://127.0.0.1:{ports['broker']}", "--mqtt-simulated",
                "--sim-fall-every", "1", "--fall-dwell", "8", "--occupancy-hold", "5",
            ], folder / "live.log")
            programs.append(live)
            check(home, live, live_url, broker, hass)
            for name in ENTITIES:
                print(f"     {name}: {', '.join(map(str, home.seen[name]))}")
            complaints = [line for line in (folder / "hass.log").read_text().splitlines() if "mqtt" in line.lower()]
            print(f"     lines about MQTT in Home Assistant's log: {len(complaints)}")
            for line in complaints[:10]:
                print(f"     {line}")
            print("all checks passed")
            return 0
        except (Failed, OSError) as failed:
            print(f"FAIL {failed}")
            for program in programs:
                lines = pathlib.Path(program.log).read_text().splitlines()
                print(f"--- {os.path.basename(program.log)}", *lines[-20:], sep="\n")
            return 1
        finally:
            for program in reversed(programs):
                program.end()


if __name__ == "__main__":
    sys.exit(main())
