#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::prepare {

struct ExportRequest {
  std::filesystem::path source;               ///< whatever io::open_source() opens
  std::filesystem::path out;                  ///< .npz or .pt, as io::open_shard_writer() takes them
  std::vector<std::filesystem::path> splits;  ///< ids to write; none: all
  std::size_t most = 0;                       ///< only so many of the first; 0: all
  bool keep_going = false;                    ///< leave out what cannot be written, which reads everything twice
};

struct ExportSummary {
  std::size_t written = 0;
  std::vector<std::string> left_out;  ///< "<id>: <reason>"
};

/// Writes rigs into one file with many samples, each under its id, one at a time in memory.
/// @throws InputError naming the first asset that cannot be written, unless asked to keep going; when nothing is left;
/// when the file to write is one that is read; Interrupted after Ctrl-C, with nothing written
ExportSummary export_shard(const ExportRequest& request);

}  // namespace anigen::prepare
