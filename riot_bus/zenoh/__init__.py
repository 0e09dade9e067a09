"""The link to Zenoh, and the only room that imports it: sessions, library copies, segments, junction, links."""
