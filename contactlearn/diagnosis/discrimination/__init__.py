"""Effects that these data cannot tell apart, and the drops that would tell them apart."""
