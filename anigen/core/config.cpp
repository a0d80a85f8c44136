#include "anigen/core/config.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/text.h"

namespace anigen {

namespace {

// Looks at what a parser would build, without building it: brackets and commas outside strings.
void check_size(std::string_view text, const std::string& file, const JsonLimits& limits) {
  std::size_t depth = 0, values = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto fail = [&](const std::string& problem) { throw InputError(file, "byte " + std::to_string(i), problem); };
    const char c = text[i];
    if (in_string) {
      if (c == '\\')
        ++i;
      else if (c == '"')
        in_string = false;
      continue;
    }
    const bool opens = c == '{' || c == '[';
    if (c == '"')
      in_string = true;
    else if ((c == '}' || c == ']') && depth > 0)
      --depth;
    if (opens && ++depth > limits.depth) fail("JSON nested deeper than " + std::to_string(limits.depth) + " levels");
    if ((opens || c == ',') && ++values > limits.values)
      fail("more than " + std::to_string(limits.values) + " JSON values");
  }
}

namespace fs = std::filesystem;

constexpr std::size_t kLongestChain = 16;
constexpr std::size_t kLongestPath = 64;

std::vector<std::string> base_files(const Json& config, const std::string& file) {
  const auto entry = config.find("extends");
  if (entry == config.end()) return {};
  const InputError wrong(file, "/extends", "must be a file name or a list of file names");
  std::vector<std::string> names;
  if (entry->is_string()) {
    names.push_back(entry->get<std::string>());
  } else if (entry->is_array()) {
    for (const Json& name : *entry) {
      if (!name.is_string()) throw wrong;
      names.push_back(name.get<std::string>());
    }
  } else {
    throw wrong;
  }
  return names;
}

// `open` are the files being read, outermost first: a file met again among them is a cycle.
Json load(const fs::path& path, std::vector<fs::path>& open) {
  const fs::path identity = fs::weakly_canonical(path);
  if (std::find(open.begin(), open.end(), identity) != open.end())
    throw InputError(open.back().string(), "/extends", "cycle: " + path.string() + " is already being read");
  if (open.size() >= kLongestChain) {
    throw InputError(open.back().string(), "/extends",
                     "chain of more than " + std::to_string(kLongestChain) + " files");
  }
  Json config = read_json(path);
  if (!config.is_object()) throw InputError(path.string(), "", "a config must be a JSON object");
  open.push_back(identity);
  Json merged = Json::object();
  for (const std::string& name : base_files(config, path.string()))
    merge_config(merged, load(path.parent_path() / name, open));
  open.pop_back();
  config.erase("extends");
  merge_config(merged, config);
  return merged;
}

bool other_name(const Json& a, const Json& b) {
  const auto x = a.find("name"), y = b.find("name");
  return x != a.end() && y != b.end() && *x != *y;
}

Json parse_value(const std::string& text) {
  try {
    return parse_json(text, "--set");
  } catch (const InputError&) {
    return text;
  }
}

std::size_t list_index(const std::string& key, std::size_t size, const std::string& assignment) {
  const bool digits = !key.empty() && key.size() < 10 && key.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || std::stoul(key) >= size)
    throw InputError("--set", assignment, "'" + key + "' is no index into a list of " + std::to_string(size));
  return std::stoul(key);
}

const Json& empty_object() {
  static const Json object = Json::object();
  return object;
}

bool is_int64(const Json& value) {
  if (!value.is_number_integer()) return false;
  return !value.is_number_unsigned() ||
         value.get<std::uint64_t>() <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
}

}  // namespace

Json parse_json(std::string_view text, const std::string& file, const JsonLimits& limits) {
  check_size(text, file, limits);
  try {
    return Json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    std::string reason = error.what();
    const std::size_t colon = reason.find(": ");
    if (colon != std::string::npos) reason = reason.substr(colon + 2);
    throw InputError(file, "byte " + std::to_string(error.byte), "not valid JSON: " + reason);
  } catch (const nlohmann::json::exception& error) {
    // A number beyond double, such as 1e999, is reported as another kind of exception.
    throw InputError(file, "", std::string("not valid JSON: ") + error.what());
  }
}

std::string escaped_for_pointer(const std::string& key) { return replaced_characters(key, {{'~', "~0"}, {'/', "~1"}}); }

Json read_json(const std::filesystem::path& path, const JsonLimits& limits) {
  return parse_json(read_file(path, std::uintmax_t{1} << 30), path.string(), limits);
}

Json load_config(const fs::path& path) {
  std::vector<fs::path> open;
  return load(path, open);
}

void merge_config(Json& base, const Json& changes) {
  if (!base.is_object() || !changes.is_object() || other_name(base, changes)) {
    base = changes;
    return;
  }
  for (const auto& [key, value] : changes.items()) {
    if (base.contains(key)) {
      merge_config(base[key], value);
    } else {
      base[key] = value;
    }
  }
}

void apply_override(Json& config, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) throw InputError("--set", assignment, "expected path.to.key=value");
  const std::string path = assignment.substr(0, equals);
  Json* place = &config;
  std::size_t depth = 0;
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('.', begin), path.size());
    const std::string key = path.substr(begin, end - begin);
    if (key.empty()) throw InputError("--set", assignment, "empty name in the path");
    if (++depth > kLongestPath) throw InputError("--set", assignment, "path too deep");
    if (place->is_array()) {
      place = &(*place)[list_index(key, place->size(), assignment)];
    } else if (place->is_object()) {
      place = &(*place)[key];
      if (place->is_null() && end < path.size()) *place = Json::object();
    } else {
      throw InputError("--set", assignment, "'" + path.substr(0, begin ? begin - 1 : 0) + "' is not an object");
    }
    begin = end + 1;
  }
  *place = parse_value(assignment.substr(equals + 1));
}

void apply_overrides(Json& config, const std::vector<std::string>& assignments) {
  for (const std::string& assignment : assignments) apply_override(config, assignment);
}

void write_config(const fs::path& path, const Json& config) { write_file_atomically(path, config.dump(2) + "\n"); }

namespace {

// Notes what a key is read as. @param schema null: any form
void record(const ConfigReader& reader, const std::string& key, Json schema, Json fallback = nullptr) {
  if (ConfigRecord::current() == nullptr) return;
  Json& node = ConfigRecord::current()->node(reader.pointer_to(key));
  if (node.is_null()) node = Json::object();
  // A reader that looks at the value itself takes other forms, too.
  constexpr const char* kFree = "any form";
  if (node.value("$comment", "") == kFree) schema = Json::object();
  if (schema.is_null()) {
    node = {{"$comment", kFree}};
    return;
  }
  node.update(schema);
  const Json required = ConfigRecord::current()->node(reader.pointer_to("")).value("required", Json::array());
  const bool optional = std::find(required.begin(), required.end(), key) == required.end();
  if (!fallback.is_null() && optional) node["default"] = std::move(fallback);
}

}  // namespace

ConfigReader::ConfigReader(const Json& object, std::string file, std::string pointer)
    : object_(&object), file_(std::move(file)), pointer_(std::move(pointer)) {
  if (!object.is_object())
    throw InputError(file_, pointer_, std::string("expected an object, found ") + object.type_name());
}

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
  if (ConfigRecord::current() != nullptr) {
    Json& required = ConfigRecord::current()->node(pointer_)["required"];
    if (required.is_null()) required = Json::array();
    if (std::find(required.begin(), required.end(), key) == required.end()) required.push_back(key);
  }
  if (!has(key)) throw error("", "the key '" + key + "' is missing");
}

template <typename T, typename Check>
T ConfigReader::value(const std::string& key, const T& fallback, const char* what, Check check, Json schema) {
  record(*this, key, std::move(schema), fallback);
  const Json* value = find(key);
  if (value == nullptr) return fallback;
  if (!check(*value)) throw error(key, std::string("expected ") + what + ", found " + value->dump().substr(0, 40));
  return value->get<T>();
}

std::int64_t ConfigReader::integer(const std::string& key, std::int64_t fallback, std::int64_t lowest,
                                   std::int64_t highest) {
  Json schema = {{"type", "integer"}};
  if (lowest > std::numeric_limits<std::int64_t>::min()) schema["minimum"] = lowest;
  if (highest < std::numeric_limits<std::int64_t>::max()) schema["maximum"] = highest;
  const std::int64_t number = value(key, fallback, "an integer", is_int64, std::move(schema));
  if (has(key) && (number < lowest || number > highest)) {
    throw error(key, "expected an integer from " + std::to_string(lowest) + " to " + std::to_string(highest) +
                         ", found " + std::to_string(number));
  }
  return number;
}

double ConfigReader::number(const std::string& key, double fallback, double lowest, double highest) {
  Json schema = {{"type", "number"}};
  if (lowest > std::numeric_limits<double>::lowest()) schema["minimum"] = lowest;
  if (highest < std::numeric_limits<double>::max()) schema["maximum"] = highest;
  const auto is_number = [](const Json& json) { return json.is_number(); };
  const double number = value(key, fallback, "a number", is_number, std::move(schema));
  if (has(key) && (!std::isfinite(number) || number < lowest || number > highest)) {
    throw error(key, "expected a number from " + Json(lowest).dump() + " to " + Json(highest).dump() + ", found " +
                         object_->at(key).dump());
  }
  return number;
}

bool ConfigReader::boolean(const std::string& key, bool fallback) {
  return value(key, fallback, "true or false", [](const Json& json) { return json.is_boolean(); },
               {{"type", "boolean"}});
}

std::string ConfigReader::text(const std::string& key, const std::string& fallback) {
  return value(key, fallback, "a string", [](const Json& json) { return json.is_string(); }, {{"type", "string"}});
}

std::string ConfigReader::choice(const std::string& key, const std::string& fallback,
                                 const std::vector<std::string>& words) {
  const std::string word = text(key, fallback);
  if (ConfigRecord::current() != nullptr) {
    record(*this, key, {{"enum", words}});
    // Without a default where the key must be there.
    if (std::find(words.begin(), words.end(), fallback) == words.end())
      ConfigRecord::current()->node(pointer_to(key)).erase("default");
  }
  if (std::find(words.begin(), words.end(), word) != words.end()) return word;
  throw error(key, "expected one of " + joined(words) + "; found '" + word.substr(0, 40) + "'");
}

template <typename T, typename Check>
std::vector<T> ConfigReader::list(const std::string& key, const std::vector<T>& fallback, const char* what,
                                  Check check) {
  record(*this, key, {{"type", "array"}, {"items", {{"type", std::string(what, std::strlen(what) - 1)}}}}, fallback);
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
  record(*this, key, {{"type", "object"}});
  const Json* value = find(key);
  return ConfigReader(value == nullptr ? empty_object() : *value, file_, pointer_to(key));
}

const Json* ConfigReader::raw(const std::string& key) {
  record(*this, key, nullptr);
  return find(key);
}

void ConfigReader::ignore(const std::string& key) {
  record(*this, key, {{"description", "has no effect"}});
  if (find(key) != nullptr) log::warn_once(file_ + ": " + pointer_to(key) + " has no effect here");
}

void ConfigReader::finish() const {
  if (ConfigRecord::current() != nullptr) ConfigRecord::current()->node(pointer_)["additionalProperties"] = false;
  for (const auto& [key, value] : object_->items()) {
    if (std::find(known_.begin(), known_.end(), key) != known_.end()) continue;
    throw error("", "unknown key '" + key.substr(0, 80) + "'; " + suggestion(key, known_, "known keys are "));
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

std::string suggestion(const std::string& word, const std::vector<std::string>& words, const std::string& all) {
  const std::string nearest = nearest_word(word, words);
  return nearest.empty() ? all + joined(words) : "did you mean '" + nearest + "'?";
}

namespace {

thread_local ConfigRecord* current_record = nullptr;

void complete(Json& config, const Json& schema) {
  if (!config.is_object() || !schema.contains("properties")) return;
  for (const auto& [key, property] : schema["properties"].items()) {
    if (!config.contains(key)) {
      if (property.contains("default")) config[key] = property["default"];
      if (!property.contains("properties")) continue;
      Json below = Json::object();
      complete(below, property);
      if (!below.empty()) config[key] = std::move(below);
    } else {
      complete(config[key], property);
    }
  }
}

}  // namespace

ConfigRecord* ConfigRecord::current() { return current_record; }

ConfigRecord::ConfigRecord() : before_(std::exchange(current_record, this)) {}

ConfigRecord::~ConfigRecord() { current_record = before_; }

Json& ConfigRecord::node(const std::string& pointer) {
  std::vector<std::string> parts;
  for (Json::json_pointer left(pointer); !left.empty(); left.pop_back()) parts.push_back(left.back());
  Json* node = &schema_;
  for (auto part = parts.rbegin(); part != parts.rend(); ++part) {
    const bool index = part->find_first_not_of("0123456789") == std::string::npos;
    node = index ? &(*node)["items"] : &(*node)["properties"][*part];
  }
  return *node;
}

Json ConfigRecord::completed(const Json& config) const {
  Json whole = config;
  complete(whole, schema_);
  return whole;
}

}  // namespace anigen
