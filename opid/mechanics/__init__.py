"""What moves, when the law is known: laws, structures and their response, backbones, and a body driven from below."""
