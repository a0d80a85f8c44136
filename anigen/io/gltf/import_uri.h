#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

namespace anigen::io::gltf_import {

/// What a glTF's "uri" member refers to.
struct Resource {
  std::string bytes;
  std::string mime_type;  ///< of a data URI; may be empty
};

/// Reads a data URI, or a file named by a plain relative path inside `folder`. Everything else is refused before
/// any file is touched: other schemes, absolute paths, parent folders (also percent-encoded), backslashes, NUL. So is a
/// link that leads out of the folder.
/// @param place JSON pointer of the uri, for the message @param max_bytes of the decoded content
/// @throws InputError
Resource read_uri(const std::string& uri, const std::filesystem::path& folder, const std::string& file,
                  const std::string& place, std::uintmax_t max_bytes);

/// The path of the file that a URI names, percent-decoded and checked as above; there may be no such file.
/// @throws InputError
std::filesystem::path path_of_uri(const std::string& uri, const std::filesystem::path& folder, const std::string& file,
                                  const std::string& place);

/// True for the text that Git LFS leaves in place of a file that was not downloaded.
bool is_git_lfs_pointer(const std::string& bytes);

}  // namespace anigen::io::gltf_import
