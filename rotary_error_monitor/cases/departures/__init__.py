"""Departures: how real faults differ from their textbook forms, each by a mechanism that the plant simulates."""

from rotary_error_monitor.cases.departures.departure import AnyFault, Departure, Part, Varied, acting
from rotary_error_monitor.cases.departures.draws import MECHANISMS, SHARES, vary_fault
from rotary_error_monitor.cases.departures.textbook import TextbookFit, fit_textbook

__all__ = [
    "MECHANISMS",
    "SHARES",
    "AnyFault",
    "Departure",
    "Part",
    "TextbookFit",
    "Varied",
    "acting",
    "fit_textbook",
    "vary_fault",
]
