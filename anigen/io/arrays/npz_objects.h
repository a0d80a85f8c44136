#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::io {

/// The object array of a member whose data is this pickle, as nested lists by its shape (0-d: the object itself).
/// @param first_byte where the pickle begins in the member, for messages
NpzValue unpickle_object_array(std::string pickle, const std::vector<std::int64_t>& shape, std::size_t first_byte,
                               const NpyPlace& place);

/// An array of fixed-width text ("<U12" or "|S12") as nested lists of strings.
NpzValue decode_text_array(const NpyHeader& header, const std::string& raw, const NpyPlace& place);

/// Appends every number and array of the tree under `name` and dotted keys below it, as read_npz documents.
/// @throws NotSupportedError when the tree is or lists plain strings
void append_numeric_leaves(const NpzValue& value, const std::string& name, const NpyPlace& place, NamedArrays& out);

}  // namespace anigen::io
