"""passloc agents: who decides how the observer moves."""

from agents.agent_file import AgentFile, AgentFileError
from agents.catalogue import RULE_NAMES, PolicyError, default_policies, find_policy
from agents.learned import LearnedPolicy
from agents.policy import Policy
from agents.rules import Circle, FlyAt, Legs, Perpendicular, Random, Stationary, Straight, Zigzag

__all__ = [
    "RULE_NAMES",
    "AgentFile",
    "AgentFileError",
    "Circle",
    "FlyAt",
    "LearnedPolicy",
    "Legs",
    "Perpendicular",
    "Policy",
    "PolicyError",
    "Random",
    "Stationary",
    "Straight",
    "Zigzag",
    "default_policies",
    "find_policy",
]
