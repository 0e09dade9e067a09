"""Advanced publishers (caches, recovery, late joiners) on intercepted keys: ended here, played again over there.

In every other segment an advanced publisher of ours keeps the cache, with its own sequence numbers. Its destination is
its own session, so nobody hears what is put into it; what is to be heard goes out through a plain publisher under the
same number. So history can be stored without reaching live subscribers a second time.

A `Terminator` notices advanced publishers and has a `Relay` for each. The relay's `StandIn`s are what other segments
see. A `Keeper` fetches from `Upstream` what a publisher keeps; all that may take long happens on the thread of a
`Worker`.
"""
