#pragma once
#include <filesystem>
#include <map>
#include <string>

#include "anigen/io/ndarray.h"

namespace anigen::io {

struct SafetensorsFile {
  NamedArrays tensors;                          ///< in order of their offsets in the file
  std::map<std::string, std::string> metadata;  ///< the "__metadata__" entry
};

/// Checks header length, ranges, overlaps, gaps and dtypes before reading. @param prefix only tensors whose names begin
/// so are read @throws InputError with the byte offset
SafetensorsFile read_safetensors(const std::filesystem::path& path, const std::string& prefix = {});

/// The "__metadata__" entry alone. Reads and checks the header, also against the size of the file, and none of the
/// data.
/// @throws InputError as read_safetensors()
std::map<std::string, std::string> read_safetensors_metadata(const std::filesystem::path& path);

/// Atomic; equal input gives equal bytes. The data section starts at a multiple of 8 bytes, tensors follow each other
/// in the order given without gaps (which the format forbids). @throws Error when a name is taken twice or reserved
void write_safetensors(const std::filesystem::path& path, const NamedArrays& tensors,
                       const std::map<std::string, std::string>& metadata = {});

}  // namespace anigen::io
