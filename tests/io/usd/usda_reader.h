#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace anigen::test {

/// A value of a .usda file: a word, text, path or number; or a list or tuple of values; or values at times.
struct UsdaValue {
  std::string text;
  std::vector<UsdaValue> items;
  std::map<double, UsdaValue> samples;

  double number() const { return std::stod(text); }
  std::vector<double> numbers() const;  ///< of all items, flattened
  std::vector<std::string> texts() const;
};

/// A prim of a .usda file. Relationships and connections are attributes whose text is a path.
struct UsdaPrim {
  std::string type, name;
  std::map<std::string, UsdaValue> metadata, attributes;
  std::map<std::string, std::string> types;                         ///< of attributes: "point3f[]"
  std::map<std::string, std::map<std::string, UsdaValue>> details;  ///< of attributes: interpolation, elementSize
  std::vector<UsdaPrim> children;

  const UsdaPrim& child(const std::string& name) const;  ///< @throws std::runtime_error when there is none
  const UsdaValue& operator[](const std::string& attribute) const;
};

/// The part of the format that the project writes. The metadata of the stage are those of the first prim, which has
/// neither type nor name. @throws std::runtime_error naming the place for anything else, brackets that do not match
/// among it
UsdaPrim parse_usda(std::string_view text);

}  // namespace anigen::test
