"""Configuration that people write: riot.toml, endpoints, quantities; nothing here starts or imports Zenoh."""
