"""One controller: its numbers, from a rig, poles and a reading of U; and the plants it meets."""
