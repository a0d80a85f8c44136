#include "anigen/io/arrays/pickle_json.h"

#include <cstddef>
#include <string>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

constexpr int kDeepestJson = 64;  // also ends cycles
constexpr std::size_t kMostJsonValues = 1'000'000;

class PlainValues {
 public:
  explicit PlainValues(const NpyPlace& place) : place_(place) {}

  Json visit(const pickle::Value& value, int depth) {
    if (depth > kDeepestJson) fail("objects are nested too deeply, or contain themselves");
    if (++visits_ > kMostJsonValues) fail("too many objects");
    switch (value.kind) {
      case pickle::Kind::kBool:
        return value.integer != 0;
      case pickle::Kind::kInt:
        return value.integer;
      case pickle::Kind::kFloat:
        return value.real;
      case pickle::Kind::kString:
        return std::string(value.text);
      case pickle::Kind::kList:
      case pickle::Kind::kTuple: {
        Json list = Json::array();
        for (const pickle::Value* item : value.items) list.push_back(visit(*item, depth + 1));
        return list;
      }
      case pickle::Kind::kDict: {
        Json object = Json::object();
        for (std::size_t i = 0; i + 1 < value.items.size(); i += 2) {
          const pickle::Value& key = *value.items[i];
          const bool is_text = key.kind == pickle::Kind::kString;
          if (!is_text && key.kind != pickle::Kind::kInt) continue;
          object[is_text ? std::string(key.text) : std::to_string(key.integer)] = visit(*value.items[i + 1], depth + 1);
        }
        return object;
      }
      default:
        return nullptr;
    }
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(place_.file, place_.member, problem); }

  const NpyPlace& place_;
  std::size_t visits_ = 0;
};

}  // namespace

Json plain_json(const pickle::Value& value, const NpyPlace& place) { return PlainValues(place).visit(value, 0); }

}  // namespace anigen::io
