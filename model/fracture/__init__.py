"""What breaks: springs or cells, one at a time, in small strain, under a load that is scaled."""
