"""What does a mistake look like? The field, the value, and what is allowed."""

import surefoot

for points, friction in (([[100, 100, 0], [100, -100, 0]], 0.5), ([[0.1, 0.1]], 0.5), ([[0.1, 0.1, 0.0]], -1.0)):
    try:
        surefoot.stability.contacts(points, friction=friction)
    except surefoot.SurefootError as error:
        print(f"[{error.code}] {error}")
