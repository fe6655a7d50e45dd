"""Kubernetes manifest of a system, from its compose file: `python scripts/kubernetes.py [COMPOSE FILE]` prints it.

One pod with a container per service: they share loopback, where the router listens. Another pod would need an endpoint
beyond it, and certificates.
"""

import sys
from pathlib import Path
from typing import Any

import yaml

from surefoot.services.supervisor.processes.compose import Compose, ComposeService, load_compose

ROOT = Path(__file__).parents[1]
HEAD = "# Made by scripts/kubernetes.py from compose/{}, for `kubectl apply -f`; the image is compose/Containerfile.\n"


def manifest(compose: Compose) -> dict[str, Any]:
    """Return the deployment of a system."""
    labels = {"app.kubernetes.io/name": "surefoot", "app.kubernetes.io/instance": compose.name}
    containers = [container(service) for service in compose.services.values()]
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": f"surefoot-{compose.name}", "labels": labels},
        "spec": {
            "replicas": 1,
            "strategy": {"type": "Recreate"},  # never two drivers of one robot
            "selector": {"matchLabels": labels},
            "template": {
                "metadata": {"labels": labels},
                "spec": {"terminationGracePeriodSeconds": 10, "containers": containers},
            },
        },
    }


def container(service: ComposeService) -> dict[str, Any]:
    """Return the container of a service; it ends a service that reports no health, as the supervisor does."""
    made: dict[str, Any] = {
        "name": service.name,
        "image": "surefoot",
        "imagePullPolicy": "IfNotPresent",
        "command": list(service.command),
        "env": [{"name": name, "value": value} for name, value in sorted(service.environment.items())],
    }
    check = service.healthcheck
    if check is not None:
        probe = {"exec": {"command": ["surefoot", "health", service.name]}, "timeoutSeconds": 5}
        tries = max(1, round(check.start_period_s / 5.0))
        made["startupProbe"] = {**probe, "periodSeconds": 5, "failureThreshold": tries}
        made["livenessProbe"] = {**probe, "periodSeconds": 10, "failureThreshold": check.retries}
    return made


class _Plain(yaml.SafeDumper):
    """Writes what occurs twice twice, without anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def text(path: Path) -> str:
    """Return the manifest of a compose file as YAML."""
    return HEAD.format(path.name) + yaml.dump(manifest(load_compose(path)), Dumper=_Plain, sort_keys=False, width=120)


if __name__ == "__main__":
    sys.stdout.write(text(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "compose" / "ragno.yaml"))
