#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/core/config.h"

namespace anigen {

/// Bounds of an integer or a number in a config, both included.
template <typename T>
struct FieldRange {
  T lowest = std::numeric_limits<T>::lowest(), highest = std::numeric_limits<T>::max();
};

enum class FieldNeed { kOptional, kRequired };
inline constexpr FieldNeed kRequired = FieldNeed::kRequired;

// clang-format off
/// Visitor of the fields of an options struct. The struct lists its fields once, in a member function
/// `void fields(ConfigFields&)`, by name in JSON, member and range:
///
///   void SkinDecoderOptions::fields(ConfigFields& f) {
///     f("num_heads", num_heads, {1, 64});               // bool, integers, double, string, path, lists of them, optional
///     f("norm_type", norm_type, {"layer", "group"});    // one of a few words, or an enum: {{"l1", Norm::kL1}, …}
///     f("channels", channels, kRequired);
///     f.object("encoder_config", encoder_config);       // another struct with fields()
///   }
///
/// The value a member has before a read is its default.
// clang-format on
class ConfigFields {
 public:
  using Need = FieldNeed;

  /// Reads, with the checks and the messages of ConfigReader; the caller calls reader.finish() when all fields of the
  /// object have been visited.
  explicit ConfigFields(ConfigReader& reader) : reader_(&reader) {}
  /// Writes to an object, which lives as long.
  explicit ConfigFields(Json& json) : json_(&json) {}

  bool reads() const { return reader_ != nullptr; }
  bool writes() const { return json_ != nullptr; }
  /// The reader, in a read alone.
  ConfigReader& reader() { return *reader_; }

  /// @throws InputError when reading another type, a value out of range, or no value of a required field
  void operator()(const std::string& name, std::int64_t& value, FieldRange<std::int64_t> range = {},
                  Need need = Need::kOptional);
  void operator()(const std::string& name, double& value, FieldRange<double> range = {}, Need need = Need::kOptional);
  void operator()(const std::string& name, bool& value, Need need = Need::kOptional);
  void operator()(const std::string& name, std::string& value, Need need = Need::kOptional);
  void operator()(const std::string& name, std::string& value, const std::vector<std::string>& words,
                  Need need = Need::kOptional);
  void operator()(const std::string& name, std::filesystem::path& value, Need need = Need::kOptional);
  void operator()(const std::string& name, std::vector<std::int64_t>& value, Need need = Need::kOptional);
  void operator()(const std::string& name, std::vector<double>& value, Need need = Need::kOptional);
  void operator()(const std::string& name, std::vector<std::string>& value, Need need = Need::kOptional);

  /// Integer of another type; the range keeps it inside that type.
  template <typename T, std::enable_if_t<std::is_integral_v<T>, int> = 0>
  void operator()(const std::string& name, T& value, FieldRange<std::int64_t> range, Need need = Need::kOptional) {
    auto wide = static_cast<std::int64_t>(value);
    (*this)(name, wide, range, need);
    value = static_cast<T>(wide);
  }
  /// Enum under the words of a config.
  template <typename T, std::enable_if_t<std::is_enum_v<T>, int> = 0>
  void operator()(const std::string& name, T& value, const std::vector<std::pair<std::string, T>>& words,
                  Need need = Need::kOptional) {
    std::vector<std::string> known;
    std::string word;
    for (const auto& [text, meaning] : words) {
      known.push_back(text);
      if (meaning == value && word.empty()) word = text;
    }
    (*this)(name, word, known, need);
    for (const auto& [text, meaning] : words) {
      if (text == word) value = meaning;
    }
  }
  /// Value that may be absent or null: unset then, and written as null.
  template <typename T, typename... Limits>
  void operator()(const std::string& name, std::optional<T>& value, Limits... limits) {
    if (null(name, value.has_value())) {
      if (!reads() || reader_->has(name)) value.reset();
      return;
    }
    T held{};
    if (value) held = *value;
    (*this)(name, held, limits...);
    value = held;
  }
  /// Integer that may be null, which means 0; 0 is written as null.
  void or_null(const std::string& name, std::int64_t& value, FieldRange<std::int64_t> range);

  /// Nested object of a struct with fields(), or of a function of ConfigFields. A read finishes it.
  template <typename T>
  void object(const std::string& name, T&& value) {
    if constexpr (std::is_invocable_v<T, ConfigFields&>) {
      nested(name, value);
    } else {
      nested(name, [&value](ConfigFields& fields) { value.fields(fields); });
    }
  }
  /// Value of a form of its own. @param schema of it @param read of a value that is there @param write none: not
  /// written
  void custom(const std::string& name, const Json& schema, const std::function<void(const Json&)>& read,
              const std::function<Json()>& write = nullptr);
  /// Keys of published configs that have no effect: warned of once, or accepted silently.
  void ignored(const std::string& name);
  void unused(const std::string& name);

  /// Error about the value of a field, to be thrown by the caller.
  InputError error(const std::string& name, const std::string& problem) const;
  NotSupportedError not_supported(const std::string& name, const std::string& feature) const;

 private:
  template <typename T, typename Read>
  void visit(const std::string& name, T& value, Need need, Read read);
  void nested(const std::string& name, const std::function<void(ConfigFields&)>& fields);
  bool null(const std::string& name, bool set);

  ConfigReader* reader_ = nullptr;
  Json* json_ = nullptr;
};

/// Check of options that were read from an object. @throws InputError about `key` ("": the object) when not valid
struct OptionCheck {
  const std::string &file, &pointer;

  void operator()(bool valid, const std::string& key, const std::string& problem) const;
  /// Number of heads `key` divides the channels, and is above 0.
  void heads(const std::string& key, std::int64_t heads, std::int64_t channels) const;
};

/// Base of an options struct `Options` that has `void fields(ConfigFields&)` and perhaps
/// `void validate(const std::string& file = "", const std::string& pointer = "") const`.
template <typename Options>
struct JsonOptions {
  /// Reads the fields and validates them; the caller calls reader.finish() where nothing else is to be read.
  /// @throws InputError on a wrong type or a value out of range, NotSupportedError for what is not supported
  static Options read(ConfigReader& reader) {
    Options options = read_fields(reader);
    validate(options, reader.file(), reader.pointer_to(""), 0);
    return options;
  }
  /// @param file, pointer where the object stands, for messages
  /// @throws as read(); InputError on an unknown key, naming the nearest
  static Options from_json(const Json& json, const std::string& file = "", const std::string& pointer = "") {
    ConfigReader reader(json, file, pointer);
    Options options = read_fields(reader);
    reader.finish();
    validate(options, file, pointer, 0);
    return options;
  }
  Json to_json() const {
    Json json = Json::object();
    ConfigFields fields(json);
    Options(static_cast<const Options&>(*this)).fields(fields);
    return json;
  }

 private:
  static Options read_fields(ConfigReader& reader) {
    Options options;
    ConfigFields fields(reader);
    options.fields(fields);
    return options;
  }
  template <typename T>
  static auto validate(const T& options, const std::string& file, const std::string& pointer, int)
      -> decltype(options.validate(file, pointer)) {
    options.validate(file, pointer);
  }
  template <typename T>
  static void validate(const T& /*options*/, const std::string& /*file*/, const std::string& /*pointer*/, long) {}
};

}  // namespace anigen
