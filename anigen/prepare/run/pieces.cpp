#include "anigen/prepare/run/pieces.h"

#include <algorithm>
#include <cstdio>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/prepare/run/run_lock.h"

namespace anigen::prepare {

namespace fs = std::filesystem;

fs::path pieces_folder(const fs::path& out) { return run_folder(out) / "pieces"; }

Pieces::Pieces(const fs::path& out, const std::string& phase, const Shard& shard, std::size_t tasks,
               std::size_t per_piece)
    : folder_(pieces_folder(out)),
      prefix_(phase + "-" + shard.name() + "-"),
      tasks_(tasks),
      per_piece_(std::max<std::size_t>(1, per_piece)) {}

std::pair<std::size_t, std::size_t> Pieces::range(std::size_t piece) const {
  return {piece * per_piece_, std::min(tasks_, (piece + 1) * per_piece_)};
}

std::string Pieces::name(std::size_t piece) const {
  char number[24];
  std::snprintf(number, sizeof number, "%06zu", piece);
  return prefix_ + number;
}

fs::path Pieces::file(std::size_t piece) const { return folder_ / (name(piece) + ".json"); }

std::optional<std::vector<SourceOutcome>> Pieces::read(std::size_t piece) const {
  std::error_code error;
  if (!fs::exists(file(piece), error)) return std::nullopt;
  try {
    std::vector<SourceOutcome> outcomes;
    for (const Json& outcome : read_json(file(piece))) outcomes.push_back(source_outcome_from_json(outcome));
    const auto [begin, end] = range(piece);
    if (outcomes.size() == end - begin) return outcomes;
  } catch (const std::exception&) {
    return std::nullopt;
  }
  return std::nullopt;
}

void Pieces::write(std::size_t piece, const std::vector<SourceOutcome>& outcomes) const {
  Json json = Json::array();
  for (const SourceOutcome& outcome : outcomes) json.push_back(to_json(outcome));
  write_file_atomically(file(piece), json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace anigen::prepare
