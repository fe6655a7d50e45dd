"""What happens to a bad sample? It raises, or it is counted: the caller chooses."""

import surefoot

strict, lenient = (surefoot.estimation.estimator(feet=4, refused=policy) for policy in ("raise", "count"))
try:
    strict.imu(0, [0.0, 0.0, float("nan")], [0.0, 0.0, 9.81])
except surefoot.SurefootError as error:
    print(error)
print(lenient.imu(0, [0.0, 0.0, float("nan")], [0.0, 0.0, 9.81]), dict(lenient.check.counts))
