"""Whether security was asked for in the environment of a process, and what of it is not in effect.

rcl reads three variables, and takes each value but one for a no: `ROS_SECURITY_ENABLE` must be `true` and
`ROS_SECURITY_STRATEGY` must be `Enforce`, in these letters. Anything else starts nodes without protection, in silence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rotary_error_monitor.security.layout import ENCLAVE_FILES, ENCLAVES

ENABLE = "ROS_SECURITY_ENABLE"
STRATEGY = "ROS_SECURITY_STRATEGY"
KEYSTORE = "ROS_SECURITY_KEYSTORE"
_ON, _ENFORCE = "true", "Enforce"

_PROTECTING = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp", "rmw_connextdds")
"""Middlewares that refuse to start a node whose keys they cannot use; of others it is not known."""

_NO = ("false", "0", "off", "no")


@dataclass(frozen=True)
class Security:
    """What was asked for, and what lacks.

    Attributes:
        asked: what asks for it, in words; empty where nobody does.
        enforced: whether a node shall rather not start than start without it.
        lacking: what is not in effect, one sentence each; empty where all is, or nothing was asked for.
    """

    asked: str
    enforced: bool
    lacking: tuple[str, ...]

    @property
    def complaint(self) -> str:
        """One sentence for people; empty where there is nothing to say."""
        return (
            f"security is asked for ({self.asked}) and is not in effect: {'; '.join(self.lacking)}"
            if self.lacking
            else ""
        )


def judge(environment: Mapping[str, str], enclave: str, middleware: str, *, required: bool) -> Security:
    """Hold what is asked for against what is there.

    Args:
        environment: variables of the process.
        enclave: name of the enclave that the process runs in, such as `/compensation`.
        middleware: identifier such as `rmw_fastrtps_cpp`.
        required: whether a parameter of the node asks for security, whatever the environment says.
    """
    asked = asked_by(environment, required=required)
    if not asked:
        return Security("", False, ())
    enforced = required or environment.get(STRATEGY, "").casefold() == _ENFORCE.casefold()
    return Security(asked, enforced, tuple(_lacking(environment, enclave, middleware)))


def asked_by(environment: Mapping[str, str], *, required: bool = False) -> str:
    """What asks for security, in words; empty where nothing does: an explicit no outweighs a keystore that is named."""
    if not required and environment.get(ENABLE, "").casefold() in _NO:
        return ""
    named = [f"{name}={environment[name]}" for name in (ENABLE, STRATEGY, KEYSTORE) if environment.get(name)]
    return ", ".join((["parameter security:=required"] if required else []) + named)


def _lacking(environment: Mapping[str, str], enclave: str, middleware: str) -> Iterator[str]:
    enable, strategy = environment.get(ENABLE, ""), environment.get(STRATEGY, "")
    if enable != _ON:
        yield f"{ENABLE} is {enable!r}, which ROS takes for a no; set it to {_ON!r}"
    if strategy != _ENFORCE:
        yield f"{STRATEGY} is {strategy!r}, with which nodes without keys start as well; set it to {_ENFORCE!r}"
    yield from _lacking_files(environment.get(KEYSTORE, ""), enclave)
    if middleware not in _PROTECTING:
        yield f"of {middleware} it is not known that it protects; use one of {', '.join(_PROTECTING)}"


def _lacking_files(keystore: str, enclave: str) -> Iterator[str]:
    if not keystore:
        yield f"{KEYSTORE} is not set; make a keystore with: rotary_error_monitor security keys FOLDER"
        return
    folder = Path(keystore) / ENCLAVES / enclave.lstrip("/")
    if not (Path(keystore) / ENCLAVES).is_dir():
        yield f"{keystore} is no keystore; make one with: rotary_error_monitor security keys {keystore}"
    elif enclave == "/" and not (folder / "key.pem").is_file():
        yield "the node runs in no enclave of its own; start it with --ros-args --enclave /<its name>"
    elif not folder.is_dir():
        yield f"{keystore} has no enclave {enclave}; make it with: rotary_error_monitor security keys {keystore}"
    else:
        missing = [name for name in ENCLAVE_FILES if not (folder / name).is_file()]
        if missing:
            yield f"enclave {folder} lacks {', '.join(missing)}"
