"""Keys, certificates and signed permissions for DDS security (SROS 2), made with the program openssl.

The folder is laid out as ROS 2 expects it below ``ROS_SECURITY_KEYSTORE``: ``public``, ``private``, ``enclaves`` with
one folder per node, named by namespace and node. Who may do what comes from ``config/security/policy.yaml``. Where the
ROS 2 security tools are installed, ``ros2 security`` works on the same folder.

Source of the formats: OMG DDS Security 1.1, sections 9.3 and 9.4; names of topics below DDS: ROS 2 design, topic and
service names.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path
from xml.sax.saxutils import escape

import yaml

from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

DAYS = 3650
ALL_NODES = {"publish": ["/rosout", "/parameter_events"], "subscribe": ["/parameter_events", "/clock"]}
PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
KINDS = ("publish", "subscribe", "serve", "call", "act", "ask")
ACTION_SERVICES, ACTION_TOPICS = ("send_goal", "cancel_goal", "get_result"), ("feedback", "status")
GRAPH = "ros_discovery_info"
"""The topic by which ROS 2 nodes tell each other what they are; without a prefix on the wire."""


def policy():
    """Node to {kind of `KINDS`: names}, with what every node has."""
    found = yaml.safe_load(config_file("security/policy.yaml").read_text(encoding="utf-8"))
    for node, rules in found.items():
        for kind, names in ALL_NODES.items():
            rules[kind] = [*rules.get(kind, []), *names]
        rules["serve"] = [*rules.get("serve", []), *(f"{node}/{name}" for name in PARAMETER_SERVICES)]
    return found


def full_name(namespace, name):
    """A name as ROS 2 has it."""
    return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"


def wire_names(namespace, rules):
    """Names of DDS topics that a node may write and read: two sorted lists."""
    writes, reads = {GRAPH}, {GRAPH}

    def service(name, served):
        request, reply = f"rq{name}Request", f"rr{name}Reply"
        (reads if served else writes).add(request)
        (writes if served else reads).add(reply)

    for kind in KINDS:
        for name in (full_name(namespace, entry) for entry in rules.get(kind, [])):
            if kind in ("publish", "subscribe"):
                (writes if kind == "publish" else reads).add(f"rt{name}")
            elif kind in ("serve", "call"):
                service(name, kind == "serve")
            else:
                for part in ACTION_SERVICES:
                    service(f"{name}/_action/{part}", kind == "act")
                for part in ACTION_TOPICS:
                    (writes if kind == "act" else reads).add(f"rt{name}/_action/{part}")
    return sorted(writes), sorted(reads)


def permissions(namespace, node, rules, domain):
    """The permissions document of one node, as XML text; ``domain``: ROS_DOMAIN_ID [1]."""
    enclave = full_name(namespace, node)
    writes, reads = wire_names(namespace, rules)

    def listed(kind, names):
        topics = "".join(f"            <topic>{escape(name)}</topic>\n" for name in names)
        return f"        <{kind}>\n          <topics>\n{topics}          </topics>\n        </{kind}>\n"

    return f"""<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions>
    <grant name="{escape(enclave)}">
      <subject_name>CN={escape(enclave)}</subject_name>
      <validity>
        <not_before>2024-01-01T00:00:00</not_before>
        <not_after>2044-01-01T00:00:00</not_after>
      </validity>
      <allow_rule>
        <domains><id>{domain}</id></domains>
{listed("publish", writes)}{listed("subscribe", reads)}      </allow_rule>
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
"""


def governance(domains):
    """The governance document: nobody without a certificate, everything signed and encrypted, every topic under
    control. ``domains``: numbers (ROS_DOMAIN_ID) [1], shape (n,)."""

    def element(name, text, depth):
        return f"{'  ' * depth}<{name}>{text}</{name}>\n"

    ids = "".join(f"<id>{domain}</id>" for domain in domains)
    domain_rules = "".join(
        element(name, text, 3)
        for name, text in (
            ("allow_unauthenticated_participants", "false"),
            ("enable_join_access_control", "true"),
            ("discovery_protection_kind", "ENCRYPT"),
            ("liveliness_protection_kind", "ENCRYPT"),
            ("rtps_protection_kind", "SIGN"),
        )
    )
    topic_rules = "".join(
        element(name, text, 5)
        for name, text in (
            ("topic_expression", "*"),
            ("enable_discovery_protection", "true"),
            ("enable_liveliness_protection", "true"),
            ("enable_read_access_control", "true"),
            ("enable_write_access_control", "true"),
            ("metadata_protection_kind", "ENCRYPT"),
            ("data_protection_kind", "ENCRYPT"),
        )
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules>
    <domain_rule>
      <domains>{ids}</domains>
{domain_rules}      <topic_access_rules>
        <topic_rule>
{topic_rules}        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
"""


class Keystore:
    """One keystore.

    Parameters
    ----------
    folder : of it. namespace : of the axis. domain : number of the ROS domain; the permissions hold in it alone.
    """

    def __init__(self, folder, namespace, domain):
        self.folder, self._namespace, self._domain = Path(folder), namespace, domain
        self._public, self._private, self._enclaves = (
            self.folder / name for name in ("public", "private", "enclaves")
        )

    def make(self):
        """Make what is missing; the names of the enclaves. An authority that is there already goes on signing.

        Raises
        ------
        InputError : there is no program openssl, or it refuses.
        """
        if shutil.which("openssl") is None:
            raise InputError("openssl", "no such program", "the program openssl, for keys and signatures")
        for folder in (self._public, self._private, self._enclaves):
            folder.mkdir(parents=True, exist_ok=True)
        os.chmod(self._private, 0o700)
        key, certificate = self._private / "ca.key.pem", self._public / "ca.cert.pem"
        if not key.exists():
            _key(key)
        if not certificate.exists():
            _openssl(
                "req",
                "-x509",
                "-new",
                "-key",
                key,
                "-sha256",
                "-days",
                str(DAYS),
                "-subj",
                "/CN=microstage authority",
                "-addext",
                "keyUsage=critical,keyCertSign,cRLSign,digitalSignature",
                "-out",
                certificate,
            )
        for kind in ("identity_ca", "permissions_ca"):
            _link(self._private / f"{kind}.key.pem", key)
            _link(self._public / f"{kind}.cert.pem", certificate)
        self._sign(governance(self._domains()), self._enclaves / "governance")
        return [self._enclave(node, rules) for node, rules in policy().items()]

    def _domains(self):
        """Numbers of the domains of this keystore: those it was made for before, which its permissions name, and this
        one."""
        earlier = self._enclaves / "governance.xml"
        known = re.findall(r"<id>(\d+)</id>", earlier.read_text(encoding="utf-8")) if earlier.exists() else []
        return sorted({*map(int, known), self._domain})

    def _enclave(self, node, rules):
        name = full_name(self._namespace, node)
        folder = self._enclaves / name.lstrip("/")
        folder.mkdir(parents=True, exist_ok=True)
        for kind in ("identity_ca", "permissions_ca"):
            _link(folder / f"{kind}.cert.pem", self._public / f"{kind}.cert.pem")
        _link(folder / "governance.p7s", self._enclaves / "governance.p7s")
        if not (folder / "cert.pem").exists():
            request = folder / "request.pem"
            _key(folder / "key.pem")
            escaped = name.replace("/", "\\/")
            _openssl("req", "-new", "-key", folder / "key.pem", "-sha256", "-subj", f"/CN={escaped}", "-out", request)
            _openssl(
                "x509",
                "-req",
                "-in",
                request,
                "-CA",
                self._public / "ca.cert.pem",
                "-CAkey",
                self._private / "ca.key.pem",
                "-CAcreateserial",
                "-CAserial",
                self._private / "ca.serial",
                "-days",
                str(DAYS),
                "-sha256",
                "-out",
                folder / "cert.pem",
            )
            request.unlink()
        self._sign(permissions(self._namespace, node, rules, self._domain), folder / "permissions")
        return name

    def _sign(self, text, path):
        """A document and its signed form, clear text with a detached signature (S/MIME)."""
        document = path.with_suffix(".xml")
        document.write_text(text, encoding="utf-8")
        _openssl(
            "smime",
            "-sign",
            "-text",
            "-in",
            document,
            "-out",
            path.with_suffix(".p7s"),
            "-signer",
            self._public / "ca.cert.pem",
            "-inkey",
            self._private / "ca.key.pem",
        )


def _key(path):
    _openssl("ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", path)
    os.chmod(path, 0o600)


def _link(path, target):
    if not path.is_symlink() and not path.exists():
        path.symlink_to(os.path.relpath(target, path.parent))


def _openssl(*words):
    done = subprocess.run(
        ["openssl", *map(str, words)], capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
    )
    if done.returncode:
        raise InputError(f"openssl {words[0]}", " ".join(done.stderr.split())[-300:], "openssl 1.1.1 or later")
