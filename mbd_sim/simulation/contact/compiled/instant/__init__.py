"""What holds at one instant: states of contacts, forces, impacts, and what begins or ends."""
