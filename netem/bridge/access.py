"""Access control of netem's two routers: who may say what on which network. Zenoh denies whatever is not listed."""

from collections.abc import Sequence
from typing import Any, Final

from tis.common.channels import (
    CONTROL,
    DESTINATION,
    OPPOSITE,
    ORIGIN,
    SIDE_ON,
    Direction,
    Network,
    keys_of,
    local_keys,
    measured_keys,
    release_key,
    stop_key,
    stopped_key,
)
from tis.common.runtime.control import ControlKeys
from tis.common.scenario.control import EVERY_STATE, control_prefix
from tis.common.scenario.security import Mtls, NoSecurity, Password
from tis.common.signing import hello_key
from tis.netem.bridge.overhead import OVERHEAD

_MESSAGES: Final = (
    "put", "delete", "declare_subscriber", "query", "declare_queryable", "reply", "liveliness_token",
    "liveliness_query", "declare_liveliness_subscriber",
)  # fmt: skip
_SAYS: Final[dict[Network, Direction]] = {ORIGIN[way]: way for way in DESTINATION}

Rights = dict[str, Sequence[str]]
"""Key expressions by Zenoh's kind of message."""


def access_control(
    security: NoSecurity | Mtls | Password,
    session: str,
    network: Network,
    devices: Sequence[str] = (),
    releasers: Sequence[str] = (),
) -> dict[str, Any]:
    """Return Zenoh's ``access_control`` for netem's router on a network of the run.

    With certificates or passwords everything is denied but what the names below may say: the side of this network its
    own streams, its token and questions to netem; ``control`` the emulator's control keys and emergency stops;
    ``observers`` nothing. Both may listen. ``devices`` are keys of operators' devices, which speak with the surgeon's
    name. ``releasers`` are the names that alone may release, and stop; without any, whoever may stop may release.
    Without certificates and passwords everything is allowed but what netem alone says: the run, its end, the clock
    and mirrored tokens. Oracle: attacks on real routers, tests/system/test_security.
    """
    if isinstance(security, NoSecurity):
        return _Rules().deny_all(_of_others(session, network)).as_config("allow")
    rules, may_stop = _Rules(), _may_stop(session, anyone_releases=not releasers)
    rules.allow("side", (SIDE_ON[network],), _of_side(session, network, devices, may_stop), security)
    rules.allow("observers", security.observers, _of_observers(session), security)
    rules.allow("control", security.control, _of_control(session, may_stop), security)
    rules.allow("releasers", releasers, _of_releasers(session), security)
    rules.allow("netem", ("netem",), _of_own_clients(session, devices, may_stop), security)
    return rules.as_config("deny")


def _of_others(session: str, network: Network) -> Rights:
    """Return what no client may say: netem alone does, or the side of the other network."""
    keys = ControlKeys(session)
    away = SIDE_ON["east" if network == "west" else "west"]
    others = (
        (stopped_key(session), *local_keys(session, "east")) if network == "west" else local_keys(session, "west")
    )
    return {
        "put": (keys.end, keys.beat("netem"), keys.beat(away), hello_key(session, away), *others),
        "delete": (keys.end,),
        "declare_queryable": (keys.clock, keys.scenario("netem"), keys.scenario(away)),
        "liveliness_token": (
            keys.token("netem", "*", mirrored=False),
            keys.run("netem", "*"),
            f"{session}/{CONTROL}/mirror/**",
        ),
    }


def _may_stop(session: str, anyone_releases: bool) -> tuple[str, ...]:
    """Return the keys of those who may stop the arms."""
    return (stop_key(session), release_key(session)) if anyone_releases else (stop_key(session),)


def _of_side(session: str, network: Network, devices: Sequence[str], may_stop: Sequence[str]) -> Rights:
    keys, says, away = ControlKeys(session), _SAYS[network], SIDE_ON["east" if network == "west" else "west"]
    token = keys.token(SIDE_ON[network], "*", mirrored=False)
    east = (*local_keys(session, "east"), stopped_key(session))
    own = east if network == "east" else (*local_keys(session, "west"), *may_stop, *devices)
    # an arm, a device or the camera, which sees the measured poses, is a program of its own
    beside = (*local_keys(session, "east"), *measured_keys(session)) if network == "east" else devices
    return {
        "put": (
            *keys_of(says, session),
            keys.beat(SIDE_ON[network]),
            hello_key(session, SIDE_ON[network]),
            *own,
        ),
        "declare_subscriber": (
            hello_key(session, away),
            *keys_of(OPPOSITE[says], session),
            keys.end,
            keys.beats,
            *beside,
            *((stop_key(session), release_key(session)) if network == "east" else (stopped_key(session),)),
        ),
        "query": (keys.clock, keys.scenario("netem")),
        "declare_queryable": (keys.scenario(SIDE_ON[network]),),
        "reply": (keys.scenario(SIDE_ON[network]),),
        "liveliness_token": (token, keys.run(SIDE_ON[network], "*")),
        "liveliness_query": (keys.tokens,),
        "declare_liveliness_subscriber": (keys.tokens,),
    }


def _of_observers(session: str) -> Rights:
    keys, prefix = ControlKeys(session), control_prefix(session)
    return {
        "declare_subscriber": (f"{session}/**", keys.end, keys.beats, stopped_key(session)),
        "query": (keys.clock, f"{prefix}state", f"{prefix}schema", EVERY_STATE),
        "liveliness_query": (keys.tokens,),
        "declare_liveliness_subscriber": (keys.tokens,),
    }


def _of_control(session: str, may_stop: Sequence[str]) -> Rights:
    rights, prefix = _of_observers(session), control_prefix(session)
    return rights | {"query": (*rights["query"], f"{prefix}*"), "put": (f"{prefix}*", *may_stop)}


def _of_releasers(session: str) -> Rights:
    """Return the rights of those who alone may release: also to stop, which is the safe side, and to observe."""
    return _of_observers(session) | {"put": (stop_key(session), release_key(session))}


def _of_own_clients(session: str, devices: Sequence[str], may_stop: Sequence[str]) -> Rights:
    """Return the rights of netem's own clients: the live page, also as a device, and the overhead's probes."""
    rights, own = _of_control(session, may_stop), (f"{OVERHEAD}/**", *devices)
    return {kind: (*keys, *own) if kind in ("put", "declare_subscriber") else keys for kind, keys in rights.items()}


class _Rules:
    """Rules, subjects and policies in Zenoh's form."""

    def __init__(self) -> None:
        self._rules: list[dict[str, Any]] = []
        self._subjects: list[dict[str, Any]] = []
        self._policies: list[dict[str, Any]] = []

    def allow(self, role: str, names: Sequence[str], rights: Rights, security: Mtls | Password) -> None:
        """Allow a role to say what ``rights`` lists and to hear everything but Zenoh's admin space."""
        if not names:
            return
        proof = "cert_common_names" if isinstance(security, Mtls) else "usernames"
        self._subjects.append({"id": role, proof: list(names)})
        ids = [self._add(f"{role} says {kind}", [kind], keys, "ingress", "allow") for kind, keys in rights.items()]
        ids.append(
            self._add(f"{role} hears", _MESSAGES, ("**", f"*/{CONTROL}/**", f"{OVERHEAD}/**"), "egress", "allow")
        )
        self._policies.append({"rules": ids, "subjects": [role]})

    def deny_all(self, rights: Rights) -> "_Rules":
        """Deny everybody what ``rights`` lists."""
        self._subjects.append({"id": "anybody"})
        ids = [self._add(f"nobody says {kind}", [kind], keys, "ingress", "deny") for kind, keys in rights.items()]
        self._policies.append({"rules": ids, "subjects": ["anybody"]})
        return self

    def _add(self, name: str, messages: Sequence[str], keys: Sequence[str], flow: str, permission: str) -> str:
        self._rules.append(
            {
                "id": name, "messages": list(messages), "flows": [flow], "permission": permission,
                "key_exprs": list(keys),
            }
        )  # fmt: skip
        return name

    def as_config(self, default: str) -> dict[str, Any]:
        return {
            "enabled": True,
            "default_permission": default,
            "rules": self._rules,
            "subjects": self._subjects,
            "policies": self._policies,
        }
