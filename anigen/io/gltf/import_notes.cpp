#include "anigen/io/gltf/import_notes.h"

namespace anigen::io::gltf_import {
namespace {

// Distinct sentences of one code; more would bury the report.
constexpr std::size_t kMostSentences = 8;

}  // namespace

void Notes::add(const std::string& code, const std::string& sentence) {
  std::size_t same = 0;
  for (const Entry& entry : entries_) {
    if (entry.code != code) continue;
    if (entry.text == sentence || ++same >= kMostSentences) return;
  }
  entries_.push_back({code, sentence, 0});
}

void Notes::tally(const std::string& code, const std::string& what, std::size_t count) {
  if (count == 0) return;
  for (Entry& entry : entries_) {
    if (entry.code == code && entry.text == what) {
      entry.count += count;
      return;
    }
  }
  entries_.push_back({code, what, count});
}

std::vector<ImportNote> Notes::take() const {
  std::vector<ImportNote> result;
  for (const Entry& entry : entries_) {
    result.push_back({entry.code, entry.count == 0 ? entry.text : std::to_string(entry.count) + " " + entry.text});
  }
  return result;
}

}  // namespace anigen::io::gltf_import
