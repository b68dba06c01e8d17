"""The Pliant specification: conventions, schemas, reading and writing, validation."""
