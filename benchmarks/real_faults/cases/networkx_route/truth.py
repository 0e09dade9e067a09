"""A control: there is no fault to trigger."""


def nominal():
    for i in range(90):
        if i % 3 == 0:
            letter, column = "ABCDEF"[i // 3 % 6], i // 3 % 5 + 1
            a, b = f"{letter}{column}", f"{letter}{column + 1}"
            yield i * 0.2, "lane", {"a": a, "b": b, "cost": 1.0 + 0.5 * (i % 4), "open": i % 7 != 0}
        else:
            start, end = f"{'ABCDEF'[i % 6]}{i % 5 + 1}", f"{'FEDCBA'[i // 2 % 6]}{6 - i % 4}"
            yield i * 0.2, "ask", {"start": start, "end": end, "robot": f"cart-{i % 4}", "load": 20.0 + i}
