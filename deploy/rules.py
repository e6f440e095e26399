"""What no tool checks of the files beside this: called by `check`."""

import json
import re
import sys
from pathlib import Path

import yaml


def fail(*faults):
    sys.exit("\n".join(f"deploy/rules.py: {fault}" for fault in faults))


def compose(file):
    """Every service is confined, bounded, and has time to end."""
    services = yaml.safe_load(Path(file).read_text())["services"]
    faults = []
    for name, service in services.items():
        once = service.get("restart") == "no"
        wanted = {
            "read_only": service.get("read_only") is True,
            "cap_drop: [ALL]": service.get("cap_drop") == ["ALL"],
            "a limit of memory": once or service.get("deploy", {}).get("resources", {}).get("limits", {}).get("memory"),
            "no Docker socket": "docker.sock" not in json.dumps(service.get("volumes", [])),
            "no privileges": not service.get("privileged"),
        }
        if str(service.get("image", "")).startswith("gable"):
            wanted["stop_grace_period: 40s"] = service.get("stop_grace_period") == "40s"
            wanted["a health check"] = "healthcheck" in service
        faults += [f"compose.yaml: {name} lacks {what}" for what, there in wanted.items() if not there]
    faults or print(f"{len(services)} services are confined and bounded")
    if faults:
        fail(*faults)


def kubernetes(folder):
    """What kustomization.yaml names is there, selectors find their pods, and the pods fit the namespace's policy."""
    folder = Path(folder)
    named = yaml.safe_load((folder / "kustomization.yaml").read_text())["resources"]
    there = {file.name for file in folder.glob("*.yaml")} - {"kustomization.yaml", "secret-example.yaml"}
    faults = [f"kustomization.yaml and the folder differ: {name}" for name in there.symmetric_difference(named)]
    objects = [made for name in sorted(there) for made in yaml.safe_load_all((folder / name).read_text())]
    pods = {made["metadata"]["name"]: made["spec"]["template"] for made in objects
            if made["kind"] in ("Deployment", "Job")}
    labels = [pod["metadata"]["labels"] for pod in pods.values()]
    ports = {port["name"] for pod in pods.values() for port in pod["spec"]["containers"][0].get("ports", [])}
    services = {made["metadata"]["name"] for made in objects if made["kind"] == "Service"}
    for made in objects:
        where, spec = f"{made['kind']} {made['metadata']['name']}", made.get("spec", {})
        selector = spec.get("selector", spec.get("podSelector")) if made["kind"] != "Job" else None
        if selector is not None:
            wanted = selector.get("matchLabels", selector)
            if not any(wanted.items() <= label.items() for label in labels):
                faults.append(f"{where} selects no pod")
        if made["kind"] == "HorizontalPodAutoscaler" and spec["scaleTargetRef"]["name"] not in pods:
            faults.append(f"{where} scales nothing")
        if made["kind"] == "Service":
            faults += [f"{where}: no port {port['targetPort']}" for port in spec["ports"]
                       if port["targetPort"] not in ports]
        if made["kind"] == "Ingress":
            backends = {path["backend"]["service"]["name"] for rule in spec["rules"] for path in rule["http"]["paths"]}
            faults += [f"{where}: no service {name}" for name in backends - services]
    for name, pod in pods.items():
        spec, container = pod["spec"], pod["spec"]["containers"][0]
        volumes = {volume["name"] for volume in spec["volumes"]}
        wanted = {
            "runAsNonRoot": spec["securityContext"].get("runAsNonRoot"),
            "seccompProfile": spec["securityContext"].get("seccompProfile"),
            "no escalation": container["securityContext"].get("allowPrivilegeEscalation") is False,
            "a read-only root": container["securityContext"].get("readOnlyRootFilesystem"),
            "drop ALL": container["securityContext"].get("capabilities") == {"drop": ["ALL"]},
            "a limit of memory": container["resources"]["limits"].get("memory"),
            "volumes for its mounts": {mount["name"] for mount in container["volumeMounts"]} <= volumes,
            "no token": spec.get("automountServiceAccountToken") is False,
        }
        faults += [f"{name} lacks {what}" for what, fits in wanted.items() if not fits]
    if faults:
        fail(*faults)
    print(f"{len(objects)} objects fit together")


def known(file):
    """Names with their types and labels."""
    lines = [line.split() for line in Path(file).read_text().splitlines() if line.strip() and line[0] != "#"]
    return {name: (kind, set(labels)) for name, kind, *labels in lines}


SUFFIXES = re.compile("_(bucket|sum|count)$")


def base(name, names):
    """The metric that a series belongs to; None for one that is not known."""
    if name in names:
        return name
    stem = SUFFIXES.sub("", name)
    return stem if stem != name and names.get(stem, ("",))[0] == "histogram" else None


def metrics(file, sources):
    """The sources record nothing that is not in the list; the alerts and their tests use nothing else."""
    names = known(file)
    macro = re.compile(r'\b(counter|gauge|histogram)!\(\s*"(gable_\w+)"')
    faults, recorded = [], set()
    for source in Path(sources).rglob("*.rs"):
        for kind, name in macro.findall(source.read_text()):
            recorded.add(name)
            if name not in names:
                faults.append(f"{source} records {name}, which {file} does not know")
            elif names[name][0] != kind:
                faults.append(f"{source} records {name} as {kind}, {file} has it as {names[name][0]}")
    alerts = Path(file).with_name("alerts.yaml")
    rules = [rule for group in yaml.safe_load(alerts.read_text())["groups"] for rule in group["rules"]]
    for rule in rules:
        faults += unknown(rule["expr"], names, rule["alert"])
    tests = yaml.safe_load(Path(file).with_name("alerts_test.yaml").read_text())["tests"]
    asked = [test for group in tests for test in group["alert_rule_test"]]
    fire = {test["alertname"] for test in asked if test.get("exp_alerts")}
    all_names = {rule["alert"] for rule in rules}
    faults += [f"no test shows that {name} fires" for name in sorted(all_names - fire)]
    # one that fires for one series and not for another beside it has been shown not to fire, too
    quiet = {test["alertname"] for test in asked if not test.get("exp_alerts")}
    several = {test["alertname"] for group in tests for test in group["alert_rule_test"] if len(group["input_series"]) > 2}
    faults += [f"no test shows that {name} stays quiet" for name in sorted(all_names - quiet - several)]
    if faults:
        fail(*faults)
    missing = sorted(set(names) - recorded)
    print(f"{len(recorded)} of {len(names)} metrics are recorded by src/; {len(rules)} alerts use known names")
    if missing:
        print("not recorded by any source yet:", *missing)


def unknown(query, names, where):
    """Metrics and labels of a query that the list does not have."""
    faults = []
    for name, selector in re.findall(r"\b(gable_\w+)(\{[^}]*\})?", query):
        metric = base(name, names)
        if metric is None:
            faults.append(f"{where} uses {name}, which is not in metrics.txt")
            continue
        labels = set(re.findall(r"(\w+)\s*(?:=~|!~|!=|=)", selector)) - {"job", "instance", "le"}
        faults += [f"{where}: {metric} has no label {label}" for label in labels - names[metric][1]]
    return faults


def dashboard(file, list_file):
    """Prints the queries of the dashboard as recording rules."""
    names, rules, faults = known(list_file), [], []
    used = set()
    for panel in json.loads(Path(file).read_text())["panels"]:
        for target in panel.get("targets", []):
            query = target["expr"]
            faults += unknown(query, names, f"the panel {panel['title']!r}")
            used |= {base(name, names) for name in re.findall(r"\bgable_\w+", query)}
            query = query.replace("$__rate_interval", "5m")
            rules.append({"record": f"panel:{panel['id']}:{target['refId']}", "expr": query})
    faults += [f"no panel shows {name}" for name in sorted(set(names) - used)]
    if faults:
        fail(*faults)
    print(yaml.safe_dump({"groups": [{"name": "dashboard", "rules": rules}]}))


def live(file, list_file):
    """A service that runs gives nothing that is not in the list, and with no other labels."""
    names, faults, seen = known(list_file), set(), set()
    for line in Path(file).read_text().splitlines():
        if not line or line[0] == "#":
            continue
        name, labels = re.match(r"(\w+)(\{.*\})?", line).groups()
        metric = base(name, names)
        seen.add(metric)
        if metric is None:
            faults.add(f"{name} is not in {list_file}")
        else:
            extra = set(re.findall(r'(\w+)="', labels or "")) - names[metric][1] - {"le", "quantile"}
            faults |= {f"{metric} has a label {label} that the list does not have" for label in extra}
    if faults:
        fail(*sorted(faults))
    print(f"{len(seen)} of {len(names)} metrics are there")


if __name__ == "__main__":
    command, *arguments = sys.argv[1:]
    {"compose": compose, "kubernetes": kubernetes, "metrics": metrics, "dashboard": dashboard, "live": live}[command](
        *arguments)
