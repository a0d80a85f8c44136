#include "anigen/prepare/run/source_scores.h"

#include <cmath>
#include <cstdlib>

#include "anigen/core/csv.h"
#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

bool is_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return !text.empty() && end == text.c_str() + text.size() && std::isfinite(value);
}

std::map<std::string, std::string> read_scores(const std::filesystem::path& dataset) {
  std::map<std::string, std::string> scores;
  try {
    const CsvTable table = read_csv(dataset / "metadata.csv");
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      const std::string& score = table.cell(row, "aesthetic_score");
      if (is_number(score)) scores[table.cell(row, "sha256")] = score;
    }
  } catch (const InputError&) {
    scores.clear();  // whoever reads the assets themselves says what is wrong there
  }
  return scores;
}

}  // namespace

std::string SourceScores::of(const AssetSource& source) {
  if (source.procedural() || source.format != io::RigFormat::kDataset) return "";
  auto found = by_dataset_.find(source.file);
  if (found == by_dataset_.end()) found = by_dataset_.emplace(source.file, read_scores(source.file)).first;
  const auto score = found->second.find(source.key);
  return score == found->second.end() ? "" : score->second;
}

}  // namespace anigen::prepare
