"""Where things lie in a keystore of SROS2."""

from __future__ import annotations

ENCLAVES = "enclaves"
"""Folder with one folder for each enclave."""

AUTHORITIES = ("identity_ca", "permissions_ca")

ENCLAVE_FILES = (
    *(f"{role}.cert.pem" for role in AUTHORITIES),
    "cert.pem",
    "key.pem",
    "governance.p7s",
    "permissions.p7s",
)
"""What an enclave must hold: rmw passes these six to DDS Security."""
