"""Receipts of scored submissions, signed with Ed25519, and their verification offline."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from pliant.service.audit import canonical
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.reading import sha256_file

RECEIPT_VERSION: Final = "1.0"
PRIVATE_KEY: Final = "receipts.private.pem"
PUBLIC_KEY: Final = "receipts.public.pem"
EARLIER: Final = "earlier-"


class Signer:
    """Signs receipts.

    Args:
        key: The private key.
    """

    def __init__(self, key: Ed25519PrivateKey) -> None:
        self._key = key
        self.key_id = key_id(key.public_key())

    @classmethod
    def read(cls, path: Path) -> Signer:
        """Read the private key of a challenge."""
        key = serialization.load_pem_private_key(path.read_bytes(), None)
        if not isinstance(key, Ed25519PrivateKey):
            raise CallError("this is not an Ed25519 key", path=path)
        return cls(key)

    def sign(self, receipt: Mapping[str, Any]) -> dict[str, Any]:
        """Return a receipt with the key's id and the signature of everything else."""
        document = {"receipt_version": RECEIPT_VERSION, **receipt, "key_id": self.key_id}
        signature = self._key.sign(canonical(document).encode())
        return {**document, "signature": base64.b64encode(signature).decode()}


def verify_receipt(receipt: Any, key: Ed25519PublicKey, path: Path | None = None) -> None:
    """Check that a receipt was signed with a key and not changed since.

    Args:
        receipt: The receipt.
        key: The challenge's public key.
        path: Its file, for messages.

    Raises:
        SpecError: It was not, or it is not a receipt.
    """
    if not isinstance(receipt, dict) or not isinstance(receipt.get("signature"), str):
        raise SpecError(
            "this is not a receipt", path=path, required="a JSON object with `signature`"
        )
    version = str(receipt.get("receipt_version", ""))
    if version.partition(".")[0] != RECEIPT_VERSION.partition(".")[0]:
        raise SpecError(
            "the receipt has another version",
            path=path,
            found=version[:40],
            required=RECEIPT_VERSION,
        )
    if receipt.get("key_id") != key_id(key):
        raise SpecError(
            "the receipt was signed with another key",
            path=path,
            found=f"key {str(receipt.get('key_id'))[:40]}",
            required=f"key {key_id(key)}",
            fix="Take the key from the challenge's rules page, or from its archive.",
        )
    signed = {name: value for name, value in receipt.items() if name != "signature"}
    try:
        key.verify(base64.b64decode(receipt["signature"]), canonical(signed).encode())
    except (InvalidSignature, ValueError) as error:
        raise SpecError(
            "the signature does not match: the receipt was changed or is not genuine",
            path=path,
            where="signature",
        ) from error


def check_file(receipt: Mapping[str, Any], file: Path) -> None:
    """Check that a receipt is of a file.

    Raises:
        SpecError: It is of another one.
    """
    found = sha256_file(file)
    if found != receipt.get("file_sha256"):
        raise SpecError(
            "the receipt is of another file",
            path=file,
            found=f"sha256 {found}",
            required=str(receipt.get("file_sha256")),
        )


def read_public_key(path: Path) -> Ed25519PublicKey:
    """Read a public key.

    Raises:
        CallError: The file is not an Ed25519 key in PEM.
    """
    try:
        key = serialization.load_pem_public_key(path.read_bytes())
    except (ValueError, UnsupportedAlgorithm) as error:
        raise CallError("this is not a public key", path=path, required="PEM") from error
    if not isinstance(key, Ed25519PublicKey):
        raise CallError("this is not an Ed25519 key", path=path)
    return key


def write_keys(folder: Path) -> None:
    """Make a key pair; the private one is readable by its owner alone."""
    folder.mkdir(mode=0o755, exist_ok=True)
    key = Ed25519PrivateKey.generate()
    public = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    write_secret(folder / PRIVATE_KEY, _private_pem(key))
    (folder / PUBLIC_KEY).write_bytes(public)


def encrypted_key(path: Path, passphrase: bytes) -> bytes:
    """Return the private key of a file, encrypted with a passphrase (PEM)."""
    key = serialization.load_pem_private_key(path.read_bytes(), None)
    return _private_pem(key, serialization.BestAvailableEncryption(passphrase))


def decrypted_key(data: bytes, passphrase: bytes) -> bytes:
    """Return what `encrypted_key` encrypted.

    Raises:
        CallError: The passphrase is wrong.
    """
    try:
        key = serialization.load_pem_private_key(data, passphrase)
    except ValueError as error:
        raise CallError("the key cannot be decrypted", fix="Check the passphrase.") from error
    return _private_pem(key)


def key_id(key: Ed25519PublicKey) -> str:
    """Return the first 16 hexadecimal digits of the sha256 of a public key."""
    raw = key.public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
    return hashlib.sha256(raw).hexdigest()[:16]


def write_secret(path: Path, data: bytes) -> None:
    """Write a file that its owner alone can read."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(descriptor, "wb") as stream:
        stream.write(data)


def _private_pem(
    key: Any, encryption: serialization.KeySerializationEncryption | None = None
) -> bytes:
    form = serialization.PrivateFormat.PKCS8
    encryption = encryption or serialization.NoEncryption()
    data: bytes = key.private_bytes(serialization.Encoding.PEM, form, encryption)
    return data
