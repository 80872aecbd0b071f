"""``security``: keys, certificates and signed permissions of an axis for DDS security (SROS 2)."""

import os
from pathlib import Path

from microstage_ros.commands import answer, units
from microstage_ros.commands.parser import Parser
from microstage_ros.quantities.errors import InputError


def main(argv=None):
    """Run the command. Returns 0.

    Raises InputError: a domain out of range, a folder that cannot be written.
    """
    parser = Parser(
        prog="microstage security",
        description=(
            "Makes a ROS 2 keystore for the nodes of an axis: an authority, a key and a certificate per node, and"
            " signed permissions from config/security/policy.yaml. What is there already is kept; permissions are"
            " signed anew. The private folder is a secret."
        ),
    )
    parser.add_argument("--keystore", required=True, metavar="DIR", help="folder of the keystore")
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the axis (default /axis)"
    )
    parser.add_argument(
        "--domain",
        type=int,
        default=os.environ.get("ROS_DOMAIN_ID") or "0",
        metavar="N",
        help="ROS domain in which the permissions hold (default: ROS_DOMAIN_ID, else 0)",
    )
    arguments = parser.parse_args(argv)
    if not 0 <= arguments.domain <= 232:
        raise InputError("--domain", arguments.domain, "0 to 232")
    from microstage_ros.ros.launching.keystore import Keystore

    folder = Path(arguments.keystore).resolve()
    try:
        enclaves = Keystore(folder, arguments.namespace, arguments.domain).make()
    except OSError as error:
        raise InputError("--keystore", str(folder), f"a folder that can be written ({error.strerror})") from None
    answer.state(keystore=str(folder), domain=arguments.domain, enclaves=enclaves)
    print(
        f"{folder}: {len(enclaves)} enclaves below {arguments.namespace}, domain {arguments.domain}. To use it:\n"
        f"  export ROS_SECURITY_KEYSTORE={folder} ROS_SECURITY_ENABLE=true ROS_SECURITY_STRATEGY=Enforce "
        f"ROS_SECURITY_ENCLAVE_OVERRIDE={arguments.namespace}/operator"
    )
    return 0
