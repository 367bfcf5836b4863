"""Camera poses against truth: seven-parameter alignment of the projection centres (Horn 1987), errors in the truth's unit."""
import math
import pathlib


def read_colmap_images(path):
    """{image name: (quaternion wxyz of cam_from_world, projection centre)} of a COLMAP images.txt."""
    poses, pose_line = {}, True
    for line in pathlib.Path(path).read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            continue
        if pose_line:
            if not line.strip():
                continue
            fields = line.split(None, 9)
            q, t = [float(x) for x in fields[1:5]], [float(x) for x in fields[5:8]]
            r = rotation(q)
            poses[fields[9]] = (q, [-sum(r[k][i] * t[k] for k in range(3)) for i in range(3)])
        pose_line = not pose_line
    return poses


def read_strecha_centres(folder):
    """{image name: projection centre in metres}: line 8 of each NAME.camera."""
    centres = {}
    for path in sorted(pathlib.Path(folder).glob("*.camera")):
        numbers = [float(x) for x in path.read_text().split()]
        centres[path.name[: -len(".camera")]] = numbers[21:24]
    return centres


def rotation(q):
    w, x, y, z = (value / math.sqrt(sum(v * v for v in q)) for value in q)
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]


def largest_eigenvector(matrix):
    """Of a symmetric matrix, by Jacobi rotations."""
    n = len(matrix)
    a = [row[:] for row in matrix]
    v = [[float(i == j) for j in range(n)] for i in range(n)]
    for _ in range(100):
        if sum(a[i][j] ** 2 for i in range(n) for j in range(n) if i != j) < 1e-28 * (1 + sum(a[i][i] ** 2 for i in range(n))):
            break
        for p in range(n):
            for q in range(p + 1, n):
                if a[p][q] == 0:
                    continue
                theta = (a[q][q] - a[p][p]) / (2 * a[p][q])
                t = math.copysign(1, theta) / (abs(theta) + math.sqrt(theta * theta + 1))
                c = 1 / math.sqrt(t * t + 1)
                s = t * c
                for k in range(n):
                    a[k][p], a[k][q] = c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]
                for k in range(n):
                    a[p][k], a[q][k] = c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]
                for k in range(n):
                    v[k][p], v[k][q] = c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]
    best = max(range(n), key=lambda i: a[i][i])
    return [v[k][best] for k in range(n)]


def centre_errors(estimated, truth):
    """Distances |truth - (s R estimated + t)| by name, after the least-squares similarity over the names in both."""
    names = sorted(set(estimated) & set(truth))
    if len(names) < 3:
        return {}
    mean = lambda points: [sum(p[k] for p in points) / len(points) for k in range(3)]  # noqa: E731
    ma, mb = mean([estimated[n] for n in names]), mean([truth[n] for n in names])
    a = [[estimated[n][k] - ma[k] for k in range(3)] for n in names]
    b = [[truth[n][k] - mb[k] for k in range(3)] for n in names]
    s = [[sum(p[i] * q[j] for p, q in zip(a, b)) for j in range(3)] for i in range(3)]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = s
    q = largest_eigenvector([[xx + yy + zz, yz - zy, zx - xz, xy - yx], [yz - zy, xx - yy - zz, xy + yx, zx + xz],
                             [zx - xz, xy + yx, -xx + yy - zz, yz + zy], [xy - yx, zx + xz, yz + zy, -xx - yy + zz]])
    r = rotation(q)
    turned = [[sum(r[i][k] * p[k] for k in range(3)) for i in range(3)] for p in a]
    scale = sum(p[k] * t[k] for p, t in zip(b, turned) for k in range(3)) / sum(p[k] ** 2 for p in a for k in range(3))
    return {n: math.dist([scale * x for x in t], p) for n, t, p in zip(names, turned, b)}
