#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/prepare/run/shard.h"
#include "anigen/prepare/steps/source_outcome.h"

namespace anigen::prepare {

/// The tasks of one phase of a run, cut into pieces that processes take by lease; what became of a piece is the file
/// run/pieces/<phase>-<shard>-<number>.json, which all of them read.
class Pieces {
 public:
  /// @param per_piece tasks that are leased together, at least 1
  Pieces(const std::filesystem::path& out, const std::string& phase, const Shard& shard, std::size_t tasks,
         std::size_t per_piece);

  std::size_t size() const { return (tasks_ + per_piece_ - 1) / per_piece_; }
  std::size_t of_task(std::size_t task) const { return task / per_piece_; }
  /// First task of a piece, and the first that is not its any more.
  std::pair<std::size_t, std::size_t> range(std::size_t piece) const;
  std::string name(std::size_t piece) const;

  /// @return nothing when nobody has finished it, or the file is damaged: it is then done again
  std::optional<std::vector<SourceOutcome>> read(std::size_t piece) const;
  void write(std::size_t piece, const std::vector<SourceOutcome>& outcomes) const;  ///< atomic

 private:
  std::filesystem::path file(std::size_t piece) const;

  std::filesystem::path folder_;
  std::string prefix_;
  std::size_t tasks_, per_piece_;
};

/// Where the files of all pieces lie.
std::filesystem::path pieces_folder(const std::filesystem::path& out);

}  // namespace anigen::prepare
