"""Networks that break: one spring at a time, in small strain, under a load that is scaled."""
