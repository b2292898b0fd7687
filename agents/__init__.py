"""passloc agents: who decides how the observer moves."""

from agents.agent_file import AgentFile, AgentFileError
from agents.catalogue import PLANNER_NAMES, RULE_NAMES, PolicyError, default_policies, find_policy, rules_for
from agents.learned import LearnedPolicy
from agents.planners import Greedy, Horizon, WithTruth
from agents.policy import Policy, TruthKnowing
from agents.rules import Circle, FlyAt, Legs, Perpendicular, Random, Stationary, Straight, Zigzag
from agents.shipped import agents_for, load, shipped_agents

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
    "agents_for",
    "default_policies",
    "find_policy",
    "load",
    "rules_for",
    "shipped_agents",
]
