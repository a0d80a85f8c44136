#pragma once
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/io/arrays/npz.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// One sample dictionary of Articulation-XL 2.0 (docs/reference/riggers.md, 3): vertices, faces, normals, joints,
/// joint_names, bones [B, 2] (parent, child), root_index, and skin weights in coordinate form, whose keys end in
/// `_row`/`_col` or `_rows`/`_cols`; entries of one vertex and joint add up. `pc_w_norm` is on another scale and is not
/// read. Numbers stay in the file's frame.
/// @param file for messages, with the sample's id
/// @param content_id set, when not null, to the content_id() of the arrays, also when the sample is refused
/// @throws InputError naming the key: wrong sizes, indices out of range, numbers that are not finite, a joint with two
/// parents, a cycle, no joint
RiggedShape shape_from_articulation_xl(const NpzValue& sample, const std::string& id, const std::string& file,
                                       std::string* content_id = nullptr);

/// An NPZ file with one object array of such dictionaries (any name; other members, such as the stray `allow_pickle`,
/// are ignored). Opening reads the file once and keeps where each sample lies (NpzSamples); a sample is read when it is
/// asked for. Samples that share lists or arrays are all read at once, which takes about three times their uncompressed
/// size, and kept in single precision.
/// Samples that cannot be read are told of when they are read, and have an id all the same.
/// @throws InputError when the file is damaged, no member holds sample dictionaries, a sample has no uuid, two have the
/// same one, or reading at once would take more memory than the machine has
std::unique_ptr<ShapeSource> open_articulation_xl(const std::filesystem::path& file, const SourceOptions& options = {});

}  // namespace anigen::io
