"""Certificate and key of an OPC UA application, made by itself, and what a server reads of them (OPC 10000-6, 6.2)."""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.security.keystore import validity, write_key

APPLICATION = "urn:rotary_error_monitor:opcua_server"
"""Application URI of the server, which a client holds against its certificate."""

_SIZE = 2048
"""Bits of the key; Basic256Sha256 takes from 2048 to 4096."""

_HOW = "make both by `rotary_error_monitor security opcua FOLDER`"


def write_application(folder: Path, hosts: Sequence[str], days: int) -> tuple[Path, Path]:
    """Write `certificate.pem` and `key.pem` into a folder, the key readable by its owner alone; give both paths.

    Args:
        folder: made where it is not there.
        hosts: names and addresses by which clients reach the server.
        days: how long the certificate is valid.

    Raises:
        InputError: a file is there already, or cannot be written.
    """
    certificate_path, key_path = folder / "certificate.pem", folder / "key.pem"
    for path in (certificate_path, key_path):
        if path.exists():
            raise InputError(f"{path} is there already, and clients may trust it; give another folder, or remove it")
    key = rsa.generate_private_key(public_exponent=65537, key_size=_SIZE)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_key(key_path, key)
        certificate_path.write_bytes(_certificate(key, hosts, days).public_bytes(Encoding.PEM))
    except OSError as error:
        raise InputError(f"{folder}: certificate and key cannot be written ({error})") from error
    return certificate_path, key_path


def application_uri(certificate: Path, key: Path) -> str:
    """Application URI of a certificate whose key is that of the other file.

    Raises:
        InputError: one of them cannot be read, they do not belong together, or the certificate names no application.
    """
    try:
        read = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"certificate {certificate}: not to be read ({error}); expected PEM: {_HOW}") from error
    try:
        private = load_pem_private_key(key.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"private_key {key}: not to be read ({error}); expected PEM without a password: {_HOW}"
        ) from error
    if not isinstance(private, rsa.RSAPrivateKey) or private.public_key() != read.public_key():
        raise InputError(f"private_key {key}: not the RSA key of {certificate}; {_HOW}")
    try:
        names = read.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        found = names.get_values_for_type(x509.UniformResourceIdentifier)
    except x509.ExtensionNotFound:
        found = []
    if not found:
        raise InputError(f"certificate {certificate}: names no application (a URI in subjectAltName); {_HOW}")
    return found[0]


def _certificate(key: rsa.RSAPrivateKey, hosts: Sequence[str], days: int) -> x509.Certificate:
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "rotary_error_monitor opcua_server")])
    names: list[x509.GeneralName] = [x509.UniformResourceIdentifier(APPLICATION), *map(_host, hosts)]
    begin, end = validity(days)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
    builder = builder.serial_number(x509.random_serial_number()).not_valid_before(begin).not_valid_after(end)
    builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    uses = {"digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_cert_sign"}
    known = ("key_agreement", "crl_sign", "encipher_only", "decipher_only", *uses)
    builder = builder.add_extension(x509.KeyUsage(**{use: use in uses for use in known}), critical=True)
    roles = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    builder = builder.add_extension(x509.ExtendedKeyUsage(roles), critical=False)
    return builder.sign(key, hashes.SHA256())


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
