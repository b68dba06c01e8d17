"""Score a method of your own on the sample that Pliant contains: ten lines."""

import pliant

ds = pliant.load("sample")  # 12 ropes; or your folder, a URL, USER/NAME on the Hub


def my_method(source, target, uv):  # two frames with rgb and mask, query pixels (N, 2)
    rows, columns = target.mask.nonzero()  # your network here
    return [(columns.mean() + 0.5, rows.mean() + 0.5)] * len(uv)


scores = pliant.evaluate(ds, pliant.predict(ds, my_method))
print(f"RMSE {scores.overall['rmse_px']:.1f} px, PCK at 8 px {scores.overall['pck_8px']:.3f}")
for name in ("identity", "centroid", "rope-tracer"):
    scores = pliant.evaluate(ds, pliant.predict(ds, name))
    print(f"{name:12} {scores.overall['rmse_px']:.1f} px")
