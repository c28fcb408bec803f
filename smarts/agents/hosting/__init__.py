"""Hosts of agents: processes, Ray actors, addresses of other machines; docs/guide/hosts.md."""
