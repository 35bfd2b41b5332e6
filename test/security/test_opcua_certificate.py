"""Certificate and key of the OPC UA server: what a client holds them against, and what is refused."""

from __future__ import annotations

import stat

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.security.keystore import write_key
from rotary_error_monitor.security.opcua_certificate import application_uri


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opcua") / "keys"
    words = ["security", "opcua", str(folder), "--host", "cell.example.org", "--host", "192.0.2.7", "--days", "30"]
    assert main(words) == 0
    return folder / "certificate.pem", folder / "key.pem"


def test_it_names_the_application_and_its_hosts(made):
    certificate = x509.load_pem_x509_certificate(made[0].read_bytes())
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.UniformResourceIdentifier) == [application_uri(*made)]
    assert names.get_values_for_type(x509.DNSName) == ["cell.example.org"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["192.0.2.7"]
    assert 2048 <= certificate.public_key().key_size <= 4096
    assert 29 < (certificate.not_valid_after_utc - certificate.not_valid_before_utc).days <= 31
    assert stat.S_IMODE(made[1].stat().st_mode) == 0o600
    certificate.verify_directly_issued_by(certificate)


def test_what_is_there_is_not_overwritten(made, capsys):
    assert main(["security", "opcua", str(made[0].parent)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_wrong_files_are_refused_by_name(made, tmp_path):
    certificate, key = made
    other = tmp_path / "other.pem"
    write_key(other, ec.generate_private_key(ec.SECP256R1()))
    for files, reason in (
        ((tmp_path / "absent.pem", key), r"certificate .*absent\.pem: not to be read"),
        ((key, key), r"certificate .*key\.pem: not to be read"),
        ((certificate, certificate), r"private_key .*certificate\.pem: not to be read"),
        ((certificate, other), r"private_key .*other\.pem: not the RSA key of"),
    ):
        with pytest.raises(InputError, match=reason):
            application_uri(*files)
    assert main(["security", "opcua", str(tmp_path / "new"), "--days", "0"]) == 2
