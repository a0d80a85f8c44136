#include "anigen/core/config_reader.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/core/log.h"

namespace anigen {
namespace {

const Json& empty_object() {
  static const Json object = Json::object();
  return object;
}

bool is_int64(const Json& value) {
  if (!value.is_number_integer()) return false;
  return !value.is_number_unsigned() ||
         value.get<std::uint64_t>() <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
}

std::string joined(const std::vector<std::string>& words) {
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : ", ") + word;
  return line;
}

}  // namespace

ConfigReader::ConfigReader(const Json& object, std::string file, std::string pointer)
    : object_(&object), file_(std::move(file)), pointer_(std::move(pointer)) {
  if (!object.is_object())
    throw InputError(file_, pointer_, std::string("expected an object, found ") + object.type_name());
}

bool ConfigReader::has(const std::string& key) const { return object_->contains(key); }

std::string ConfigReader::pointer_to(const std::string& key) const {
  return key.empty() ? pointer_ : pointer_ + "/" + escaped_for_pointer(key);
}

InputError ConfigReader::error(const std::string& key, const std::string& problem) const {
  return InputError(file_, pointer_to(key), problem);
}

const Json* ConfigReader::find(const std::string& key) {
  if (std::find(known_.begin(), known_.end(), key) == known_.end()) known_.push_back(key);
  const auto found = object_->find(key);
  return found == object_->end() ? nullptr : &*found;
}

void ConfigReader::require(const std::string& key) const {
  if (!has(key)) throw error("", "the key '" + key + "' is missing");
}

std::int64_t ConfigReader::integer(const std::string& key, std::int64_t fallback, std::int64_t lowest,
                                   std::int64_t highest) {
  const Json* value = find(key);
  if (value == nullptr) return fallback;
  if (!is_int64(*value)) throw error(key, std::string("expected an integer, found ") + value->dump().substr(0, 40));
  const auto number = value->get<std::int64_t>();
  if (number < lowest || number > highest) {
    throw error(key, "expected an integer from " + std::to_string(lowest) + " to " + std::to_string(highest) +
                         ", found " + std::to_string(number));
  }
  return number;
}

double ConfigReader::number(const std::string& key, double fallback, double lowest, double highest) {
  const Json* value = find(key);
  if (value == nullptr) return fallback;
  if (!value->is_number()) throw error(key, std::string("expected a number, found ") + value->dump().substr(0, 40));
  const auto number = value->get<double>();
  if (!std::isfinite(number) || number < lowest || number > highest) {
    throw error(key, "expected a number from " + Json(lowest).dump() + " to " + Json(highest).dump() + ", found " +
                         value->dump());
  }
  return number;
}

bool ConfigReader::boolean(const std::string& key, bool fallback) {
  const Json* value = find(key);
  if (value == nullptr) return fallback;
  if (!value->is_boolean()) throw error(key, "expected true or false, found " + value->dump().substr(0, 40));
  return value->get<bool>();
}

std::string ConfigReader::text(const std::string& key, const std::string& fallback) {
  const Json* value = find(key);
  if (value == nullptr) return fallback;
  if (!value->is_string()) throw error(key, "expected a string, found " + value->dump().substr(0, 40));
  return value->get<std::string>();
}

std::string ConfigReader::choice(const std::string& key, const std::string& fallback,
                                 const std::vector<std::string>& words) {
  const std::string word = text(key, fallback);
  if (std::find(words.begin(), words.end(), word) != words.end()) return word;
  throw error(key, "expected one of " + joined(words) + "; found '" + word.substr(0, 40) + "'");
}

template <typename T, typename Check>
std::vector<T> ConfigReader::list(const std::string& key, const std::vector<T>& fallback, const char* what,
                                  Check check) {
  const Json* value = find(key);
  if (value == nullptr) return fallback;
  if (!value->is_array()) throw error(key, std::string("expected a list of ") + what);
  std::vector<T> items;
  for (std::size_t i = 0; i < value->size(); ++i) {
    const Json& item = (*value)[i];
    if (!check(item)) {
      throw InputError(file_, pointer_to(key) + "/" + std::to_string(i),
                       std::string("expected a list of ") + what + ", found " + item.dump().substr(0, 40));
    }
    items.push_back(item.get<T>());
  }
  return items;
}

std::vector<std::int64_t> ConfigReader::integers(const std::string& key, const std::vector<std::int64_t>& fallback) {
  return list(key, fallback, "integers", is_int64);
}

std::vector<double> ConfigReader::numbers(const std::string& key, const std::vector<double>& fallback) {
  return list(key, fallback, "numbers", [](const Json& item) { return item.is_number(); });
}

std::vector<std::string> ConfigReader::texts(const std::string& key, const std::vector<std::string>& fallback) {
  return list(key, fallback, "strings", [](const Json& item) { return item.is_string(); });
}

ConfigReader ConfigReader::object(const std::string& key) {
  const Json* value = find(key);
  return ConfigReader(value == nullptr ? empty_object() : *value, file_, pointer_to(key));
}

const Json* ConfigReader::raw(const std::string& key) { return find(key); }

void ConfigReader::ignore(const std::string& key) {
  if (find(key) != nullptr) log::warn_once(file_ + ": " + pointer_to(key) + " has no effect here");
}

void ConfigReader::finish() const {
  for (const auto& [key, value] : object_->items()) {
    if (std::find(known_.begin(), known_.end(), key) != known_.end()) continue;
    const std::string nearest = nearest_word(key, known_);
    throw error("", "unknown key '" + key.substr(0, 80) + "'; " +
                        (nearest.empty() ? "known keys are " + joined(known_) : "did you mean '" + nearest + "'?"));
  }
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
  // Three rolling rows of the usual table: the swap of neighbours looks back two rows.
  std::vector<std::size_t> before(b.size() + 1), previous(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before.swap(previous);
    previous.swap(row);
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = previous[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({previous[j] + 1, row[j - 1] + 1, change});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row[b.size()];
}

std::string nearest_word(const std::string& word, const std::vector<std::string>& words) {
  constexpr std::size_t kLongestKey = 256;  // longer ones are not misspellings, and the table is quadratic
  if (word.size() > kLongestKey) return "";
  std::string nearest;
  std::size_t best = std::max<std::size_t>(2, word.size() / 2) + 1;
  for (const std::string& candidate : words) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best) best = distance, nearest = candidate;
  }
  return nearest;
}

}  // namespace anigen
