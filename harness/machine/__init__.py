"""What this machine has and lacks: set-up, diagnosis, the runtime that Mitsuba needs."""
