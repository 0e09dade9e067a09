"""Advanced publishers (caches, recovery, late joiners) on intercepted keys: replaced by proxies in other segments.

In every other segment, an advanced publisher of ours keeps the cache, with its own sequence numbers. Its destination is
its own session, so no component receives what is put into it; live messages are sent by a plain publisher under the
same number. So history can be stored without reaching live subscribers a second time.

`PublisherProxies` notices advanced publishers and has a `PublisherState` for each. Its `ProxyPublisher`s are what other
segments see. A `HistoryMirror` fetches from `Upstream` what a publisher keeps; everything that may take long happens on
the thread of a `Worker`.
"""
