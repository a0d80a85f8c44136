#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io {

/// The object array of a member whose data is this pickle, as nested lists by its shape (0-d: the object itself).
/// @param first_byte where the pickle begins in the member, for messages
NpzValue unpickle_object_array(std::string pickle, const std::vector<std::int64_t>& shape, std::size_t first_byte,
                               const NpyPlace& place);

/// A pickled object as a tree. @param pickle_bytes the pickle's size, which bounds the tree's
NpzValue object_tree(const pickle::Value& value, std::size_t pickle_bytes, const NpyPlace& place);

/// Header of an NPY member, and where its data begin in it. @throws InputError when they cannot be that array
struct NpyMemberHeader {
  NpyHeader header;
  std::uint64_t data = 0;
};
NpyMemberHeader read_npy_header(const ZipReader& archive, const ZipMember& member);

/// An array of fixed-width text ("<U12" or "|S12") as nested lists of strings.
NpzValue decode_text_array(const NpyHeader& header, const std::string& raw, const NpyPlace& place);

/// Appends every number and array of the tree under `name` and dotted keys below it, as read_npz documents.
/// @throws NotSupportedError when the tree is or lists plain strings
void append_numeric_leaves(const NpzValue& value, const std::string& name, const NpyPlace& place, NamedArrays& out);

}  // namespace anigen::io
