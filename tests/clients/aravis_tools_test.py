#!/usr/bin/env python3
"""Unmodified programs of Aravis and Wireshark against `atomcam serve`, on addresses of this test's own.

ATOMCAM_LONG=1 streams for a minute each; ATOMCAM_GENAPI_SCHEMA names GenApiSchema_Version_1_1.xsd."""

import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

ATOMCAM = os.environ["ATOMCAM"]
ADDRESSES = ["127.77.1.1", "127.77.1.2"]
VALUE = re.compile(r"^\s*(\w+)\s*: \[(RW|RO|WO)\] '(\w+)' = ('?)(.*?)\4(?: \S+)?$", re.MULTILINE)
RANGE = re.compile(r" (min|max):(\S+)")
# Not the client's to take away from itself, and what fires instead of keeping a value.
LEFT_ALONE = {"GevCCP", "GevSCPSFireTestPacket"}
# Addresses of one machine; the range of their register goes on to those that no frame can be sent to.
MACHINES = {"GevMCDA", "GevSCDA"}
FIRST = {"LineSource": ["LineSelector=Line1"]}  # Line0 is an input


def run(*arguments):
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


class AravisTools(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        addresses = [word for address in ADDRESSES for word in ("--address", address)]
        cls.server = subprocess.Popen([ATOMCAM, "serve", "ixon-ultra-897", "orca-quest", *addresses, "--quiet"],
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for line in cls.server.stdout:
            if line.startswith("serving"):
                return
        raise RuntimeError("atomcam serve ended before it served")

    @classmethod
    def tearDownClass(cls):
        cls.server.terminate()
        cls.server.wait(20)
        cls.server.stdout.close()

    def test_both_cameras_are_listed(self):
        _, text = run("arv-tool-0.8")
        for address in ADDRESSES:
            self.assertIn(f"({address})", text)

    def control(self, address, *words):
        """The lines that arv-tool answers with."""
        code, answer = run("arv-tool-0.8", "-a", address, "control", *words)
        self.assertEqual(code, 0, answer)
        return answer.splitlines()

    def test_every_writable_feature_takes_its_values(self):
        for address in ADDRESSES:
            _, values = run("arv-tool-0.8", "-a", address, "values")
            _, tree = run("arv-tool-0.8", "-a", address, "features")
            entries = {}  # of each enumeration, the available ones
            for line in tree.splitlines():
                if feature := re.search(r"Enumeration\s*: \[\w+\] '(\w+)'", line):
                    name = feature[1]
                elif (entry := re.search(r"EnumEntry\s*: '(\w+)'$", line)):
                    entries.setdefault(name, []).append(entry[1])
            written = 0
            for kind, access, name, _, old in VALUE.findall(values):
                if access != "RW" or name in LEFT_ALONE:
                    continue
                if kind == "Enumeration":
                    tries = entries[name]
                elif kind == "Boolean":
                    tries = ["true", "false"]
                elif kind in ("StringReg", "String"):
                    tries = ["Another name", ""]
                elif name in MACHINES:
                    tries = ["2130706433"]  # 127.0.0.1
                else:
                    self.assertIn(kind, ("Integer", "Float"))
                    old = old.split()[0]
                    line = self.control(address, name)[0]
                    tries = [value for _, value in RANGE.findall(line)] + [old]
                for value in [*tries, old]:
                    answer = self.control(address, *FIRST.get(name, []), f"{name}={value}", name)
                    with self.subTest(camera=address, feature=name, value=value):
                        self.assertNotIn("error", "".join(answer))
                        got = re.match(rf"{name} = (.*?)( min:.*| max:.*)?$", answer[-1])[1]
                        if kind in ("Integer", "Float"):
                            # What is made of lines and shifts comes back as the nearest the camera can do.
                            got = float(got.split()[0])
                            self.assertLessEqual(abs(got - float(value)), 1e-3 * abs(float(value)) + 1e-9)
                        else:
                            self.assertEqual(got, value)
                        written += 1
            self.assertGreater(written, 200)

    @unittest.skipUnless(os.environ.get("ATOMCAM_GENAPI_SCHEMA"), "ATOMCAM_GENAPI_SCHEMA names no schema")
    def test_the_served_description_follows_the_schema(self):
        for address in ADDRESSES:
            code, xml = run("arv-tool-0.8", "-a", address, "genicam")
            self.assertEqual(code, 0, xml)
            with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
                file.write(xml)
                file.flush()
                code, text = run("xmllint", "--noout", "--schema", os.environ["ATOMCAM_GENAPI_SCHEMA"], file.name)
                self.assertEqual(code, 0, text)

    def test_a_killed_client_frees_the_camera_within_its_heartbeat(self):
        heartbeat_s = float(self.control(ADDRESSES[0], "GevHeartbeatTimeout")[0].split()[2]) / 1000
        client = subprocess.Popen(["arv-camera-test-0.8", "-n", ADDRESSES[0]], stdout=subprocess.DEVNULL)
        time.sleep(1)
        code, answer = run("arv-tool-0.8", "-a", ADDRESSES[0], "control", "BlackLevel=200")
        self.assertIn("error", answer)  # the camera is the other's
        killed = time.monotonic()
        client.send_signal(signal.SIGKILL)
        client.wait()
        while "error" in answer:
            self.assertLess(time.monotonic() - killed, heartbeat_s + 0.5, answer)
            time.sleep(0.05)
            code, answer = run("arv-tool-0.8", "-a", ADDRESSES[0], "control", "BlackLevel=200")
        code, text = run("arv-camera-test-0.8", "-n", ADDRESSES[0], "--duration=1")
        self.assertEqual(code, 0, text)

    @unittest.skipUnless(shutil.which("tshark") and os.geteuid() == 0, "needs tshark and the right to capture")
    def test_wireshark_decodes_every_packet(self):
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "session.pcapng")
            with subprocess.Popen(["dumpcap", "-q", "-i", "lo", "-f", "udp and net 127.77.1.0/24", "-w", file],
                                  stderr=subprocess.PIPE, text=True) as capture:
                for line in capture.stderr:
                    if line.startswith("File:"):
                        break
                else:
                    self.skipTest("cannot capture here")
                run("arv-tool-0.8")
                for address, more in zip(ADDRESSES, (["--chunks=Timestamp"], ["--width=256", "--height=256"])):
                    run("arv-tool-0.8", "-a", address, "values")
                    code, text = run("arv-camera-test-0.8", "-n", address, "--duration=1", *more)
                    self.assertEqual(code, 0, text)
                capture.send_signal(signal.SIGINT)
                capture.wait(20)

            def fields(condition, *names, decode=()):
                words = [word for name in names for word in ("-e", name)]
                done = subprocess.run(["tshark", "-r", file, *decode, "-Y", condition, "-T", "fields", *words],
                                      capture_output=True, text=True, timeout=100)
                self.assertEqual(done.returncode, 0, done.stderr)
                return done.stdout.splitlines()

            # Streams have no port of their own: what comes from a camera and not from the control port is one.
            ports = set(fields("udp and not gvcp and ip.src == 127.77.1.0/24", "udp.dstport"))
            decode = [word for port in ports for word in ("-d", f"udp.port=={port},gvsp")]
            self.assertGreater(len(fields("gvcp", "frame.number")), 100)
            self.assertGreater(len(fields("gvsp", "frame.number", decode=decode)), 100)
            self.assertEqual(fields("_ws.malformed or (udp and not gvcp and not gvsp)", "frame.number", "_ws.col.Info",
                                    decode=decode), [])

    def test_frames_of_the_preset_stream(self):
        code, text = run("arv-camera-test-0.8", "-n", ADDRESSES[0], "--duration=3")
        self.assertEqual(code, 0, text)
        counted = dict(re.findall(r"(n_\w+)\s*[=:]\s*(\d+)", text))
        self.assertGreater(int(counted["n_completed_buffers"]), 10, text)
        self.assertEqual(int(counted["n_failures"]), 0, text)

    @unittest.skipUnless(os.environ.get("ATOMCAM_LONG"), "ATOMCAM_LONG=1 streams for a minute each")
    def test_a_minute_without_a_lost_frame(self):
        full_ixon = ["BinningHorizontal=1", "BinningVertical=1", "Width=512", "Height=512", "ReadoutRate=Rate17MHz",
                     "ExposureTime=10000", "AcquisitionFrameRateEnable=false"]
        part_of_orca = ["Width=1024", "Height=512", "ExposureTime=10000", "AcquisitionFrameRateEnable=false"]
        for address, settings in zip(ADDRESSES, (full_ixon, part_of_orca)):
            self.assertNotIn("error", "".join(self.control(address, *settings)))
            done = subprocess.run(["arv-camera-test-0.8", "-n", address, "--duration=60"], capture_output=True,
                                  text=True, timeout=100)
            text = done.stdout + done.stderr
            self.assertEqual(done.returncode, 0, text)
            counted = {name: int(count) for name, count in re.findall(r"(n_\w+)\s*[=:]\s*(\d+)", text)}
            print(address, counted)
            self.assertGreater(counted["n_completed_buffers"], 600, text)
            for name in ("n_failures", "n_underruns", "n_missing_frames", "n_missing_packets"):
                self.assertEqual(counted[name], 0, text)


if __name__ == "__main__":
    unittest.main()
