"""Standard deviations of the projection centres of an exported model: normal equations of the bundle block adjustment
written out once more, in plain Python, as an oracle. Slow: a thousand points."""
import pathlib

from poses import rotation


def read_model(folder):
    """(focal length in px, {image id: (name, rotation, centre)}, [(position, [image ids])]) of a COLMAP text export."""
    folder, images, points = pathlib.Path(folder), {}, []
    lines = [line for line in (folder / "images.txt").read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    for line in lines[::2]:
        f = line.split(None, 9)
        r, t = rotation([float(x) for x in f[1:5]]), [float(x) for x in f[5:8]]
        images[int(f[0])] = (f[9], r, [-sum(r[k][i] * t[k] for k in range(3)) for i in range(3)])
    for line in (folder / "points3D.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            f = line.split()
            points.append(([float(x) for x in f[1:4]], [int(x) for x in f[8::2]]))
    camera = [line for line in (folder / "cameras.txt").read_text().splitlines() if not line.startswith("#")][0].split()
    return float(camera[4]), images, points


def multiply(a, b):
    columns = list(zip(*b))
    return [[sum(x * y for x, y in zip(row, column)) for column in columns] for row in a]


def inverse(matrix):
    """Gauss-Jordan with pivoting."""
    n = len(matrix)
    rows = [list(row) + [float(i == j) for j in range(n)] for i, row in enumerate(matrix)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        scale = rows[k][k]
        rows[k] = [x / scale for x in rows[k]]
        for i in range(n):
            factor = rows[i][k]
            if i != k and factor:
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k])]
    return [row[n:] for row in rows]


def jacobians(focal_px, image, position):
    """(2 x 6 to the rotation exp(w) R and the centre, 2 x 3 to the point) of a projection; distortion left aside."""
    _, r, centre = image
    d = [position[i] - centre[i] for i in range(3)]
    x, y, z = (sum(r[k][i] * d[i] for i in range(3)) for k in range(3))
    to_camera = [[focal_px / z, 0, -focal_px * x / z / z], [0, focal_px / z, -focal_px * y / z / z]]
    to_point = multiply(to_camera, r)
    to_turn = multiply(to_camera, [[0, z, -y], [-z, 0, x], [y, -x, 0]])
    return [turn + [-v for v in point] for turn, point in zip(to_turn, to_point)], to_point


def centre_sigmas(folder, sigma0_px):
    """{image name: standard deviation of the centre's position}, under the datum that a similarity transformation of
    the centres onto others' implies (inner constraints of the centres alone)."""
    focal_px, images, points = read_model(folder)
    ids = sorted(images)
    place, n = {image: 6 * k for k, image in enumerate(ids)}, 6 * len(ids)
    normal = [[0.0] * (n + 7) for _ in range(n + 7)]

    def add(i, j, block, sign):
        for a, row in enumerate(block):
            for b, value in enumerate(row):
                normal[i + a][j + b] += sign * value

    for position, seen in points:
        rays = [(place[image], *jacobians(focal_px, images[image], position)) for image in seen]
        point_normal = [[sum(b[k][i] * b[k][j] for _, _, b in rays for k in range(2)) for j in range(3)] for i in range(3)]
        point_inverse = inverse(point_normal)
        mixed = [(at, multiply(list(zip(*a)), b)) for at, a, b in rays]
        for at, a, _ in rays:
            add(at, at, multiply(list(zip(*a)), a), 1)
        for i, left in mixed:
            half = multiply(left, point_inverse)
            for j, right in mixed:
                add(i, j, multiply(half, list(zip(*right))), -1)
    mean = [sum(images[image][2][k] for image in ids) / len(ids) for k in range(3)]
    for image in ids:
        x, y, z = (images[image][2][k] - mean[k] for k in range(3))
        datum = [[1, 0, 0, 0, z, -y, x], [0, 1, 0, -z, 0, x, y], [0, 0, 1, y, -x, 0, z]]
        add(place[image] + 3, n, datum, 1)
        add(n, place[image] + 3, list(zip(*datum)), 1)
    covariance = inverse(normal)
    return {images[image][0]: sigma0_px * sum(covariance[place[image] + 3 + k][place[image] + 3 + k] for k in range(3)) ** 0.5 for image in ids}
