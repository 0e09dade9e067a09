"""Services: requests to selected ones and their replies end at the router, pass the interceptors, and go on."""
