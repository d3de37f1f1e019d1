"""The only Ray code: tasks, actors and dispatch. The same work also runs in-process."""
