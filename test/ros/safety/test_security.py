"""SROS 2: keys and permissions verify, policies cover what running nodes do, and nothing runs unsecured where security is asked for."""

import os
import shutil
import stat
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from ros_support import own_domain, ros_node, spin_until

from microstage_ros.commands.__main__ import main
from microstage_ros.ros.launching.cell_processes import NODES, CellProcesses
from microstage_ros.ros.launching.forked import ForkedNodes
from microstage_ros.ros.launching.keystore import GRAPH, Keystore, policy, wire_names

needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="no program openssl")
BEYOND = ("/rosout", "/clock")  # rclpy's own, in nodes that use simulated time too


def openssl(*words):
    return subprocess.run(["openssl", *map(str, words)], capture_output=True, text=True, check=False)


@needs_openssl
def test_every_certificate_and_document_verifies(tmp_path, capsys):
    assert main(["security", "--keystore", str(tmp_path / "keys"), "--namespace", "/left", "--domain", "7"]) == 0
    assert "ROS_SECURITY_STRATEGY=Enforce" in capsys.readouterr().out
    authority = tmp_path / "keys" / "public" / "ca.cert.pem"
    folders = sorted((tmp_path / "keys" / "enclaves" / "left").iterdir())
    assert [folder.name for folder in folders] == sorted(policy())
    for folder in folders:
        assert openssl("verify", "-CAfile", folder / "identity_ca.cert.pem", folder / "cert.pem").returncode == 0
        subject = openssl("x509", "-in", folder / "cert.pem", "-noout", "-subject", "-nameopt", "multiline").stdout
        assert f"= /left/{folder.name}" in subject
        assert stat.S_IMODE((folder / "key.pem").stat().st_mode) == 0o600
        for document in ("permissions", "governance"):
            assert openssl("smime", "-verify", "-text", "-in", folder / f"{document}.p7s", "-CAfile", authority).returncode == 0
        tree = ElementTree.parse(folder / "permissions.xml")
        assert tree.findtext(".//subject_name") == f"CN=/left/{folder.name}" and tree.findtext(".//default") == "DENY"
        assert [entry.text for entry in tree.iter("id")] == ["7"]
    signed = folders[0] / "permissions.p7s"
    changed = tmp_path / "changed.p7s"
    changed.write_text(signed.read_text().replace("DENY", "ALLOW"))
    assert openssl("smime", "-verify", "-text", "-in", changed, "-CAfile", authority).returncode != 0
    before = (folders[0] / "cert.pem").read_bytes()
    Keystore(tmp_path / "keys", "/left", 8).make()  # again, for another domain: keys stay
    assert (folders[0] / "cert.pem").read_bytes() == before and "<id>8</id>" in (folders[0] / "permissions.xml").read_text()


@needs_openssl
def test_a_second_axis_of_another_domain_leaves_the_first_its_own(tmp_path):
    """One governance document is signed for all: it held the domain of the last axis alone."""
    Keystore(tmp_path, "/axis", 77).make()
    Keystore(tmp_path, "/left", 5).make()
    for name, domain in (("axis", "77"), ("left", "5")):
        folder = tmp_path / "enclaves" / name / "axis_driver"
        text = openssl("smime", "-verify", "-text", "-in", folder / "governance.p7s", "-CAfile", tmp_path / "public" / "ca.cert.pem").stdout
        assert "<domains><id>5</id><id>77</id></domains>" in text
        assert [entry.text for entry in ElementTree.parse(folder / "permissions.xml").iter("id")] == [domain]


@needs_openssl
def test_a_certificate_that_was_not_made_the_first_time_is_made(tmp_path):
    Keystore(tmp_path, "/axis", 0).make()
    (tmp_path / "public" / "ca.cert.pem").unlink()
    Keystore(tmp_path, "/axis", 0).make()
    assert (tmp_path / "public" / "ca.cert.pem").exists()


def test_a_recorder_may_read_parameters_and_set_none():
    writes = [name for name in wire_names("/axis", policy()["bag_recorder"])[0] if name.startswith("rq/")]
    assert sorted(writes) == ["rq/axis/*/get_parametersRequest", "rq/axis/*/list_parametersRequest"]


def test_nodes_have_the_enclave_of_their_name_whatever_the_command_has(monkeypatch):
    monkeypatch.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", "/axis/operator")
    nodes = ForkedNodes([])
    try:
        given = Path(f"/proc/{nodes.server_pid}/environ").read_bytes().split(b"\0")
        assert b"ROS_SECURITY_ENCLAVE_OVERRIDE=" in given and b"ROS_SECURITY_ENCLAVE_OVERRIDE=/axis/operator" not in given
    finally:
        nodes.close()


def test_only_the_controller_may_command():
    writers = {node for node, rules in policy().items() if "rt/axis/command" in wire_names("/axis", rules)[0]}
    assert writers == {"str_controller"}
    assert {node for node, rules in policy().items() if "rt/axis/state" in wire_names("/axis", rules)[0]} == {"axis_driver"}
    assert all(GRAPH in names for rules in policy().values() for names in wire_names("/axis", rules))


def test_the_policies_cover_what_running_nodes_do(tmp_path):
    parameters = {"bag_recorder": {"directory": str(tmp_path / "bag")}, "axis_driver": {"rate_limit": 1.0}}
    with ros_node() as node, CellProcesses("/axis", NODES, parameters, logs=tmp_path) as cell:
        cell.activate(node)
        spin_until(node, lambda: set(NODES) <= {name for name, _ in node.get_node_names_and_namespaces()})
        end = time.monotonic() + 2.0
        spin_until(node, lambda: time.monotonic() > end)  # the recorder subscribes to what it finds
        for name in NODES:
            writes, reads = wire_names("/axis", policy()[name])
            for found, prefix, allowed in ((node.get_publisher_names_and_types_by_node, "rt", writes),
                                           (node.get_subscriber_names_and_types_by_node, "rt", reads)):
                for topic, _ in found(name, "/axis"):
                    assert topic in BEYOND or any(fnmatchcase(f"{prefix}{topic}", entry) for entry in allowed), (name, found.__name__, topic)
            for found, read, written in ((node.get_service_names_and_types_by_node, "rq", "rr"), (node.get_client_names_and_types_by_node, "rr", "rq")):
                for service, _ in found(name, "/axis"):
                    for prefix, allowed in ((read, reads), (written, writes)):
                        wire = f"{prefix}{service}{'Request' if prefix == 'rq' else 'Reply'}"
                        assert any(fnmatchcase(wire, entry) for entry in allowed), (name, found.__name__, wire)


@needs_openssl
def test_where_the_middleware_has_no_security_nothing_runs_without(tmp_path):
    """The wheels' Fast DDS is built without its security plugins, and says so; `test_stranger.py` has those of Debian."""
    with own_domain() as domain:
        Keystore(tmp_path, "/axis", domain).make()
        environment = {**os.environ, "ROS_SECURITY_KEYSTORE": str(tmp_path), "ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
        node = [sys.executable, "-m", "microstage_ros.ros.nodes.gms_observer", "--ros-args", "-r", "__ns:=/axis", "--enclave"]
        try:
            done = subprocess.run([*node, "/axis/gms_observer"], env=environment, capture_output=True, text=True, timeout=240, check=False)
        except subprocess.TimeoutExpired:  # it runs: this middleware has security. Who has no enclave must not.
            stranger = subprocess.run([*node, "/axis/stranger"], env=environment, capture_output=True, text=True, timeout=240, check=False)
            assert stranger.returncode != 0
            return
        assert done.returncode == 2 and "Traceback" not in done.stderr
        assert "doesn't have the security libraries" in done.stderr.strip().splitlines()[-1]
