"""A private certificate authority and the certificates it signs, by the library `cryptography` (extra `security`)."""

import os
from datetime import UTC, datetime, timedelta
from importlib import import_module
from ipaddress import ip_address
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.disk import whole
from surefoot.errors import SurefootError

AUTHORITY = "ca"
"""Name, without suffix, of the files with key and certificate of the certificate authority."""
INSTALL = "pip install 'surefoot[security]'"
BEGINS_BEFORE = timedelta(minutes=5)  # clocks of two hosts may differ
LOOPBACK = ("localhost", "127.0.0.1", "::1")


class Held(NamedTuple):
    """Name and expiry of a certificate in the folder of a robot.

    Attributes:
        identity: common name in the certificate.
        until: time at which the certificate expires.
        days: days left until then; negative = it has expired.
    """

    identity: str
    until: datetime
    days: int


def held(folder: Path) -> list[Held]:
    """Return the certificates of a folder, sorted by expiry, the earliest first.

    Raises:
        SurefootError: one cannot be read, or `cryptography` is not installed.
    """
    found: list[Held] = []
    for path in folder.glob("*.pem"):
        until = _certificate(folder, path.stem).not_valid_after_utc
        found.append(Held(path.stem, until, (until - datetime.now(UTC)).days))
    return sorted(found, key=lambda one: (one.until, one.identity))


def make_authority(folder: Path, name: str, days: int) -> None:
    """Write the private key and the certificate of a new certificate authority, which expires after ``days``."""
    x509 = _library("x509")
    key = _new_key()
    builder = _begun(f"surefoot authority of {name}", key, days).issuer_name(_named(f"surefoot authority of {name}"))
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    _write(folder, AUTHORITY, key, _signed(builder, key))


def issue(folder: Path, identity: str, days: int, hosts: tuple[str, ...] = ()) -> None:
    """Write a new private key and a certificate, signed by the authority, with the common name `identity`.

    Args:
        folder: folder with the files of the authority; the new files are written there, too.
        identity: service or person.
        days: until the certificate expires; never later than the authority does.
        hosts: names and addresses, besides those of loopback, at which the process of the identity is reached.

    Raises:
        SurefootError: an authority that cannot be read or has ended.
    """
    x509 = _library("x509")
    authority, key = _certificate(folder, AUTHORITY), _new_key()
    if authority.not_valid_after_utc <= datetime.now(UTC):
        raise SurefootError("ended", f"the authority of {folder} has ended; delete the folder and make it anew")
    names = [_host(name) for name in dict.fromkeys((*LOOPBACK, *hosts))]
    builder = _begun(identity, key, days, authority.not_valid_after_utc).issuer_name(authority.subject)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    _write(folder, identity, key, _signed(builder, _authority_key(folder)))


def hosts_of(folder: Path, identity: str) -> tuple[str, ...]:
    """Return the host names and addresses for which an identity's certificate holds."""
    x509 = _library("x509")
    found = _certificate(folder, identity).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return tuple(str(name.value) for name in found)


def _begun(name: str, key: Any, days: int, latest: datetime | None = None) -> Any:
    x509 = _library("x509")
    now = datetime.now(UTC)
    end = now + timedelta(days=days)
    builder = x509.CertificateBuilder().subject_name(_named(name)).public_key(key.public_key())
    builder = builder.serial_number(x509.random_serial_number()).not_valid_before(now - BEGINS_BEFORE)
    return builder.not_valid_after(end if latest is None else min(end, latest))


def _named(name: str) -> Any:
    x509 = _library("x509")
    return x509.Name([x509.NameAttribute(_library("x509.oid").NameOID.COMMON_NAME, name)])


def _host(name: str) -> Any:
    x509 = _library("x509")
    try:
        return x509.IPAddress(ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _new_key() -> Any:
    ec = _library("hazmat.primitives.asymmetric.ec")
    return ec.generate_private_key(ec.SECP256R1())


def _signed(builder: Any, key: Any) -> Any:
    return builder.sign(key, _library("hazmat.primitives.hashes").SHA256())


def _write(folder: Path, identity: str, key: Any, certificate: Any) -> None:
    forms = _library("hazmat.primitives.serialization")
    private = key.private_bytes(forms.Encoding.PEM, forms.PrivateFormat.PKCS8, forms.NoEncryption())
    for suffix, content in (("key", private), ("pem", certificate.public_bytes(forms.Encoding.PEM))):
        with whole(folder / f"{identity}.{suffix}") as part:
            part.touch(mode=0o600)
            os.chmod(part, 0o600)
            part.write_bytes(content)


def _authority_key(folder: Path) -> Any:
    load = _library("hazmat.primitives.serialization").load_pem_private_key
    try:
        return load(_read(folder, f"{AUTHORITY}.key"), None)
    except (TypeError, ValueError):  # it has a password, or is no key
        raise SurefootError("malformed", f"{folder / f'{AUTHORITY}.key'} is no key that can be used") from None


def _certificate(folder: Path, identity: str) -> Any:
    try:
        return _library("x509").load_pem_x509_certificate(_read(folder, f"{identity}.pem"))
    except ValueError:
        raise SurefootError("malformed", f"{folder / f'{identity}.pem'} is no certificate") from None


def _read(folder: Path, name: str) -> bytes:
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        text = f"{folder / name} cannot be read ({error.strerror}); `surefoot security init` makes certificates"
        raise SurefootError("not_found", text) from None


def _library(part: str) -> Any:
    try:
        return import_module(f"cryptography.{part}")
    except ImportError:
        raise SurefootError("not_installed", f"certificates need the package cryptography: {INSTALL}") from None
