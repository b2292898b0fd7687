"""passloc agents: who decides how the observer moves."""

from agents.agent_file import AgentFile, AgentFileError
from agents.catalogue import PLANNER_NAMES, RULE_NAMES, PolicyError, default_policies, find_policy, rules_for
from agents.learned import LearnedPolicy
from agents.planners import Greedy, Horizon, WithTruth
from agents.policy import Policy, TruthKnowing
from agents.rules import Circle, FlyAt, Legs, Perpendicular, Random, Stationary, Straight, Zigzag

__all__ = [
    "PLANNER_NAMES",
    "RULE_NAMES",
    "AgentFile",
    "AgentFileError",
    "Circle",
    "FlyAt",
    "Greedy",
    "Horizon",
    "LearnedPolicy",
    "Legs",
    "Perpendicular",
    "Policy",
    "PolicyError",
    "Random",
    "Stationary",
    "Straight",
    "TruthKnowing",
    "WithTruth",
    "Zigzag",
    "default_policies",
    "find_policy",
    "rules_for",
]
