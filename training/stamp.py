"""What a policy is, in words that change whenever it would decide otherwise."""

from __future__ import annotations

import hashlib

from agents import LearnedPolicy, Policy


def stamp(policy: Policy) -> str:
    """The policy's own words, or for an agent those of its weights and of what its card says of flying."""
    if not isinstance(policy, LearnedPolicy):
        return repr(policy)
    digest = hashlib.sha256()
    for name, weights in sorted(policy.agent.weights.items()):
        digest.update(name.encode() + weights.tobytes())
    card = policy.agent.card
    return f"agent {digest.hexdigest()} mirror={card.get('mirror')} shield_sigmas={card.get('shield_sigmas')}"
