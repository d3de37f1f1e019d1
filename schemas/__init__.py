"""What lies on disk: typed records, their Arrow schemas and versions, and how they are read and committed."""
