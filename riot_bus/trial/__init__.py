"""One trial: its segments and components, what is fed to them, and the verdict on what they did."""
