"""Why a rule found something, or how far it came."""
