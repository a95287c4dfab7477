#!/usr/bin/env bash
# paho-mqtt says that a message failed, and sends it later.
#
# Guess: a QoS 1 message published without a connection is either queued (and reported so) or fails (and is gone).
# What happens: `publish` returns MQTT_ERR_NO_CONN, and `is_published` raises "Message publish failed", but the message
# is queued and goes out with the next connection. With QoS 0 it is really gone, with the same return code.
# Why it matters: a program that announces falls and repeats what failed announces every fall twice, minutes late; one
# that trusts QoS 0 alike loses it.
# What to do: decide by QoS, not by the return code, and put an id and a time into the payload. Here: the client
# is rumqttc, and after each connection the present state is published (crates/live/src/mqtt/session.rs).
source "$(dirname "$0")/lib.sh"
install paho-mqtt==2.2.0
observe <<'PYTHON'
import socket
import threading

import paho.mqtt.client as mqtt

from finding import report

# A broker that accepts one client and keeps what it is sent.
listener = socket.create_server(("127.0.0.1", 0))
received = bytearray()


def broker():
    connection, _ = listener.accept()
    with connection:
        connection.settimeout(2)
        try:
            connection.recv(1000)  # CONNECT
            connection.sendall(b"\x20\x02\x00\x00")  # CONNACK
            while part := connection.recv(1000):
                received.extend(part)
        except TimeoutError:
            pass


client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, "radar")
observed = []
for qos in (0, 1):
    message = client.publish(f"radar/fall{qos}", b"fallen", qos=qos)
    try:
        said = f"is_published {message.is_published()}"
    except RuntimeError as error:
        said = f"is_published raises {error}"
    observed.append(f"QoS {qos} without a connection: {mqtt.error_string(message.rc)} {said}")
thread = threading.Thread(target=broker)
thread.start()
client.connect("127.0.0.1", listener.getsockname()[1])
client.loop_start()
thread.join()
client.loop_stop()
for qos in (0, 1):
    observed.append(f"QoS {qos}: {bytes(received).count(f'radar/fall{qos}'.encode())} time(s) at the broker after the connection")
report(
    "what is said to have failed does not arrive",
    observed,
    [
        "QoS 0 without a connection: The client is not currently connected. is_published raises Message publish failed: The client is not currently connected.",
        "QoS 1 without a connection: The client is not currently connected. is_published raises Message publish failed: The client is not currently connected.",
        "QoS 0: 0 time(s) at the broker after the connection",
        "QoS 1: 1 time(s) at the broker after the connection",
    ],
)
PYTHON
