"""Keys and signed documents as DDS Security reads them, held against openssl, which did not make them."""

from __future__ import annotations

import shutil
import stat
import subprocess
import xml.etree.ElementTree as ET
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config
from rotary_error_monitor.security.access import Access
from rotary_error_monitor.security.keystore import write_keystore
from rotary_error_monitor.security.layout import ENCLAVE_FILES

ONE = Access("one", ("/spoken",), ("/heard",), ("/one/answered",), ("/other/asked",))
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")


def openssl(*arguments: object) -> str:
    done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True)
    return done.stdout if done.returncode == 0 else f"refused: {done.stderr}"


@pytest.fixture
def keystore(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    write_keystore(folder, [ONE, Access("two", (), ())], domain=7, days=30)
    return folder


def test_an_enclave_holds_what_the_middleware_asks_for(keystore):
    for node in ("one", "two"):
        assert all((keystore / "enclaves" / node / name).read_bytes() for name in ENCLAVE_FILES)


@needs_openssl
def test_certificates_and_documents_are_signed_by_the_authority(keystore):
    enclave, authority = keystore / "enclaves" / "one", keystore / "public" / "ca.cert.pem"
    assert openssl("verify", "-CAfile", authority, enclave / "cert.pem").endswith("OK\n")
    for name in ("governance.p7s", "permissions.p7s"):
        signed = openssl("smime", "-verify", "-text", "-in", enclave / name, "-CAfile", authority)
        assert ET.fromstring(signed.replace("\r", "").encode()).tag == "dds"
    assert "prime256v1" in openssl("x509", "-in", enclave / "cert.pem", "-noout", "-text")
    assert openssl("x509", "-in", enclave / "cert.pem", "-noout", "-subject").strip() == "subject=CN = /one"


@needs_openssl
def test_a_changed_document_and_another_authority_are_noticed(keystore, tmp_path):
    enclave = keystore / "enclaves" / "one"
    forged = tmp_path / "forged.p7s"
    forged.write_text((enclave / "permissions.p7s").read_text().replace("rt/heard", "rt/hoard"))
    assert openssl("smime", "-verify", "-in", forged, "-CAfile", keystore / "public" / "ca.cert.pem").startswith(
        "refused"
    )
    write_keystore(tmp_path / "other", [ONE], domain=7, days=30)
    other = tmp_path / "other" / "public" / "ca.cert.pem"
    assert openssl("smime", "-verify", "-in", enclave / "permissions.p7s", "-CAfile", other).startswith("refused")


def test_permissions_name_topics_as_the_wire_does_and_deny_the_rest(keystore):
    top = ET.parse(keystore / "enclaves" / "one" / "permissions.xml")
    spoken = [element.text for element in top.findall("permissions/grant/allow_rule/publish/topics/topic")]
    heard = [element.text for element in top.findall("permissions/grant/allow_rule/subscribe/topics/topic")]
    assert spoken == ["ros_discovery_info", "rq/other/askedRequest", "rr/one/answeredReply", "rt/spoken"]
    assert heard == ["ros_discovery_info", "rq/one/answeredRequest", "rr/other/askedReply", "rt/heard"]
    assert top.findtext("permissions/grant/default") == "DENY"
    assert top.findtext("permissions/grant/allow_rule/domains/id") == "7"
    assert top.findtext("permissions/grant/subject_name") == "CN=/one"
    end = datetime.fromisoformat(str(top.findtext("permissions/grant/validity/not_after"))).replace(tzinfo=UTC)
    assert timedelta(days=29) < end - datetime.now(UTC) <= timedelta(days=30)


def test_governance_lets_nobody_in_without_keys(keystore):
    rule = ET.parse(keystore / "enclaves" / "governance.xml").find("domain_access_rules/domain_rule")
    assert rule is not None
    assert rule.findtext("allow_unauthenticated_participants") == "false"
    assert rule.findtext("enable_join_access_control") == "true"
    assert rule.findtext("topic_access_rules/topic_rule/enable_write_access_control") == "true"
    assert rule.findtext("domains/id") == "7"


def test_keys_are_for_their_owner_alone(keystore):
    keys = [path for path in keystore.rglob("*key.pem") if not path.is_symlink()]
    assert {path.parent.name for path in keys} == {"private", "one", "two"}
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in keys)
    assert stat.S_IMODE((keystore / "private").stat().st_mode) == 0o700


def test_a_renewal_keeps_the_authority_and_the_other_nodes(keystore):
    before = {path: path.read_bytes() for path in keystore.rglob("*.pem")}
    write_keystore(keystore, [ONE], domain=7, days=30)
    changed = {str(path.relative_to(keystore)) for path, content in before.items() if path.read_bytes() != content}
    assert changed == {"enclaves/one/cert.pem", "enclaves/one/key.pem"}


def test_an_authority_that_cannot_sign_is_refused(keystore, tmp_path):
    key = keystore / "private" / "ca.key.pem"
    write_keystore(tmp_path / "other", [ONE], domain=7, days=30)
    for content, why in (
        (b"none", "cannot sign"),
        ((tmp_path / "other/private/ca.key.pem").read_bytes(), "not the key"),
    ):
        key.write_bytes(content)
        with pytest.raises(InputError, match=why):
            write_keystore(keystore, [ONE], domain=7, days=30)
    key.unlink()
    with pytest.raises(InputError, match="bring its key back"):
        write_keystore(keystore, [ONE], domain=7, days=30)


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_keystore(tmp_path / "file", [ONE], domain=7, days=30)


def test_the_policy_that_is_shipped_is_the_one_of_the_contract(capsys):
    assert main(["security", "policy"]) == 0
    assert config("security/policy.xml").read_text(encoding="utf-8") == capsys.readouterr().out


def test_the_command_makes_keys_of_chosen_nodes(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "5")
    listen = ["--listen", "encoder_head_a=/joint_states"]
    folder = tmp_path / "keys"
    assert main(["security", "keys", str(folder), "--node", "encoder_head_a", "--node", "operator", *listen]) == 0
    assert {path.parent.name for path in folder.glob("enclaves/*/key.pem")} == {"encoder_head_a", "operator"}
    permissions = (folder / "enclaves/encoder_head_a/permissions.xml").read_text()
    assert "<topic>rt/joint_states</topic>" in permissions and "<id>5</id>" in permissions
    assert f"ROS_SECURITY_KEYSTORE={folder}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--node", "nobody"], "no node is called nobody"),
        (["--listen", "lvdt"], "expected NODE=TOPIC"),
        (["--domain", "233"], "from 0 to 232"),
        (["--days", "0"], "--days 0"),
    ],
)
def test_wrong_arguments_are_refused(arguments, why, tmp_path, capsys):
    assert main(["security", "keys", str(tmp_path / "keys"), *arguments]) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "keys").exists()
