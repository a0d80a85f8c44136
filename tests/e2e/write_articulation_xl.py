"""Writes two Articulation-XL shards with numpy, as the published writer does: an object array of dictionaries, once with
the sparse keys of the readers (..._row, ..._col) and once with those of the writer (..._rows, ..._cols).

    write_articulation_xl.py FOLDER        exit status 77 when numpy is not installed
"""
import os
import sys

try:
    import numpy as np
except ImportError:
    sys.exit(77)


def ribbon(number, suffix):
    """A crooked ribbon of quads along a chain of joints, every vertex shared by two joints."""
    random = np.random.RandomState(number)
    count = 4 + number % 4
    joints = np.stack([0.3 * np.arange(count), 0.2 * random.rand(count), 0.2 * random.rand(count)], axis=1)
    vertices = np.concatenate([joints + [0, side, side] for side in (-0.1, 0.1)])
    quads = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    faces = np.concatenate([np.c_[quads[:, :1], quads[:, :1] + count, quads[:, 1:]],
                            np.c_[quads[:, 1:], quads[:, :1] + count, quads[:, 1:] + count]])
    own = np.tile(np.arange(count), 2)
    normals = np.tile([0.0, 0.0, 1.0], (2 * count, 1))
    return {
        "vertices": vertices,
        "faces": faces.astype(np.int64),
        "normals": normals,
        "joints": joints,
        "bones": quads.astype(np.int64),
        "root_index": 0,
        "uuid": "numpy-%d" % number,
        "pc_w_norm": random.rand(64, 6).astype(np.float16),
        "joint_names": ["joint_%d" % j for j in range(count)],
        "skinning_weights_value": np.repeat([0.75, 0.25], 2 * count),
        "skinning_weights_row" + suffix: np.tile(np.arange(2 * count), 2).astype(np.int32),
        "skinning_weights_col" + suffix: np.concatenate([own, (own + 1) % count]).astype(np.int32),
        "skinning_weights_shape": (2 * count, count),
    }


def main():
    folder = sys.argv[1]
    os.makedirs(folder)
    shards = [("articulation_xl.npz", "", range(7)), ("articulation_xl_more.npz", "s", range(7, 12))]
    for name, suffix, numbers in shards:
        samples = np.array([ribbon(number, suffix) for number in numbers], dtype=object)
        np.savez_compressed(os.path.join(folder, name), samples, allow_pickle=np.bool_(True))


main()
