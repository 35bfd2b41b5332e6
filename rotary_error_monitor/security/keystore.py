"""Keys, certificates and signed permissions of a cell, laid out as SROS2 does, so that its own tools go on with them.

Keys are elliptic (P-256) and documents are signed by S/MIME with SHA-256, as OMG DDS Security 1.1, section 9.3.1 and
9.4.1, asks. One authority signs identities and permissions; its key is needed only to add nodes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
    pkcs7,
)

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.security.access import Access
from rotary_error_monitor.security.documents import governance_xml, permissions_xml
from rotary_error_monitor.security.layout import AUTHORITIES, ENCLAVES

_AUTHORITY = "rotary_error_monitor cell"
_LEEWAY = timedelta(days=1)
"""How long before now keys are valid: the clocks of a cell's computers may not agree yet when keys are made."""

_OWNER_ONLY = 0o600


def write_keystore(folder: Path, accesses: Sequence[Access], domain: int, days: int) -> None:
    """Make or renew the keystore `folder`; an authority that is there, with its key, goes on to sign.

    Keys, certificates and permissions of the nodes in `accesses` are made anew; those of others stay.

    Args:
        folder: keystore, for `ROS_SECURITY_KEYSTORE`.
        accesses: what each node may do.
        domain: ROS domain id in which they may do it.
        days: how long keys are valid.

    Raises:
        InputError: the folder cannot be written, or holds an authority that cannot sign.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        authority = _authority(folder, days)
        governance = folder / ENCLAVES / "governance.xml"
        governance.parent.mkdir(exist_ok=True)
        governance.write_text(governance_xml(domain), encoding="utf-8")
        _sign(governance, authority)
        for access in accesses:
            _write_enclave(folder / ENCLAVES / access.node, access, authority, domain, days)
    except OSError as error:
        raise InputError(f"{folder}: the keystore cannot be written ({error})") from error


Authority = tuple[x509.Certificate, ec.EllipticCurvePrivateKey]


def _authority(folder: Path, days: int) -> Authority:
    """Certificate and key that sign, from the keystore or new."""
    certificate_path, key_path = folder / "public" / "ca.cert.pem", folder / "private" / "ca.key.pem"
    if certificate_path.exists():
        return _load_authority(certificate_path, key_path)
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, _AUTHORITY)])
    certificate = _certificate(name, key.public_key(), (name, key), days, x509.BasicConstraints(True, 1))
    for path in (certificate_path, key_path):
        path.parent.mkdir(exist_ok=True)
    key_path.parent.chmod(0o700)
    write_key(key_path, key)
    certificate_path.write_bytes(certificate.public_bytes(Encoding.PEM))
    for role in AUTHORITIES:
        _link(certificate_path.with_name(f"{role}.cert.pem"), certificate_path)
        _link(key_path.with_name(f"{role}.key.pem"), key_path)
    return certificate, key


def _load_authority(certificate_path: Path, key_path: Path) -> Authority:
    try:
        certificate = x509.load_pem_x509_certificate(certificate_path.read_bytes())
        key = load_pem_private_key(key_path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"{key_path}: the authority cannot sign ({error}); bring its key back, or make a new keystore"
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey) or certificate.public_key() != key.public_key():
        raise InputError(
            f"{key_path}: this is not the key of {certificate_path}; bring it back, or make a new keystore"
        )
    return certificate, key


def _write_enclave(folder: Path, access: Access, authority: Authority, domain: int, days: int) -> None:
    folder.mkdir(exist_ok=True)
    top = folder.parent.parent
    for role in AUTHORITIES:
        _link(folder / f"{role}.cert.pem", top / "public" / f"{role}.cert.pem")
    _link(folder / "governance.p7s", folder.parent / "governance.p7s")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, access.enclave)])
    issuer = authority[0].subject, authority[1]
    certificate = _certificate(name, key.public_key(), issuer, days, x509.BasicConstraints(False, None))
    write_key(folder / "key.pem", key)
    (folder / "cert.pem").write_bytes(certificate.public_bytes(Encoding.PEM))
    permissions = folder / "permissions.xml"
    permissions.write_text(permissions_xml(access, domain, *validity(days)), encoding="utf-8")
    _sign(permissions, authority)


def _certificate(
    subject: x509.Name,
    public_key: ec.EllipticCurvePublicKey,
    issuer: tuple[x509.Name, ec.EllipticCurvePrivateKey],
    days: int,
    constraints: x509.BasicConstraints,
) -> x509.Certificate:
    name, key = issuer
    begin, end = validity(days)
    builder = x509.CertificateBuilder().subject_name(subject).issuer_name(name).public_key(public_key)
    builder = builder.serial_number(x509.random_serial_number()).not_valid_before(begin)
    builder = builder.not_valid_after(end).add_extension(constraints, critical=constraints.ca)
    return builder.sign(key, hashes.SHA256())


def _sign(document: Path, authority: Authority) -> None:
    """Write beside `document` its signed form, `.p7s`."""
    certificate, key = authority
    builder = pkcs7.PKCS7SignatureBuilder().set_data(document.read_bytes())
    builder = builder.add_signer(certificate, key, hashes.SHA256())
    options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
    document.with_suffix(".p7s").write_bytes(builder.sign(Encoding.SMIME, options))


def write_key(path: Path, key: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey) -> None:
    """Write a private key as PEM that its owner alone may read."""
    content = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _OWNER_ONLY), "wb") as file:
        file.write(content)


def _link(path: Path, target: Path) -> None:
    path.unlink(missing_ok=True)
    path.symlink_to(os.path.relpath(target, path.parent))


def validity(days: int) -> tuple[datetime, datetime]:
    """When what is valid for so many days from now begins and ends to be."""
    now = datetime.now(UTC)
    return now - _LEEWAY, now + timedelta(days=days)
