#include "anigen/io/arrays/torch_tree.h"

#include <unordered_set>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

constexpr int kMaxDepth = 64;  // also ends cycles
constexpr std::size_t kMaxVisits = 10'000'000;

class Walker {
 public:
  explicit Walker(const NpyPlace& place) : place_(place) {}

  void visit(const pickle::Value& value, const std::string& name, int depth) {
    if (depth > kMaxDepth)
      fail("objects are nested too deeply, or contain themselves, at '" + name.substr(0, 80) + "'");
    if (++visits_ > kMaxVisits) fail("too many objects");
    switch (value.kind) {
      case pickle::Kind::kTensor:
      case pickle::Kind::kArray:
      case pickle::Kind::kBool:
      case pickle::Kind::kInt:
      case pickle::Kind::kFloat:
        if (!names_.insert(name).second) fail("two values have the path '" + name + "'");
        leaves.push_back({name, &value});
        return;
      case pickle::Kind::kDict:
        for (std::size_t i = 0; i + 1 < value.items.size(); i += 2) {
          visit(*value.items[i + 1], join(name, key(*value.items[i])), depth + 1);
        }
        return;
      case pickle::Kind::kList:
      case pickle::Kind::kTuple:
      case pickle::Kind::kSet:
      case pickle::Kind::kObjectArray:
        for (std::size_t i = 0; i < value.items.size(); ++i) {
          visit(*value.items[i], join(name, std::to_string(i)), depth + 1);
        }
        return;
      case pickle::Kind::kNone:
      case pickle::Kind::kString:
      case pickle::Kind::kBytes:
      case pickle::Kind::kDtype:
      case pickle::Kind::kOpaque:
        return;
      case pickle::Kind::kGlobal:
      case pickle::Kind::kStorage:
        throw NotSupportedError(place_.file, place_.member,
                                std::string("a bare ") + pickle::name_of(value.kind) + " at '" + name + "'");
    }
  }

  std::vector<TorchLeaf> leaves;

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(place_.file, place_.member, problem); }
  static std::string join(const std::string& name, const std::string& key) {
    return name.empty() ? key : name + "." + key;
  }
  std::string key(const pickle::Value& key) const {
    switch (key.kind) {
      case pickle::Kind::kString:
      case pickle::Kind::kBytes:
        return std::string(key.text);
      case pickle::Kind::kInt:
      case pickle::Kind::kBool:
        return std::to_string(key.integer);
      default:
        throw NotSupportedError(place_.file, place_.member,
                                std::string("a dict key that is a ") + pickle::name_of(key.kind));
    }
  }

  const NpyPlace& place_;
  std::unordered_set<std::string> names_;
  std::size_t visits_ = 0;
};

}  // namespace

std::vector<TorchLeaf> torch_leaves(const pickle::Value& root, const NpyPlace& place) {
  Walker walker(place);
  walker.visit(root, "", 0);
  return std::move(walker.leaves);
}

}  // namespace anigen::io
