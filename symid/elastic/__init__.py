"""Identification of robots whose joints give: dynamics, friction and hysteresis, from plain tracking."""
