"""Language and vision models: the chat protocol, clients, prompts, reply parsers and the call cache."""
