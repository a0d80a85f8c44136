#pragma once
#include <string>

#include "anigen/models/state_dict.h"
#include "tests/parity/fixture.h"

namespace anigen::test {

/// The parameters of one of several modules in a fixture, `param.<part>.*`, under the keys behind the part's name.
inline io::NamedArrays parameters_of(const Fixture& fixture, const std::string& part) {
  const std::string prefix = part + ".";
  io::NamedArrays found;
  for (const auto& [key, array] : fixture.parameters()) {
    if (key.compare(0, prefix.size(), prefix) == 0) found.emplace_back(key.substr(prefix.size()), array);
  }
  return found;
}

inline bool has(const io::NamedArrays& parameters, const std::string& key) {
  return io::find(parameters, key) != nullptr;
}

/// Fills a module with the parameters of a part; every key must match.
template <typename Module>
void load_part(Module& module, const Fixture& fixture, const std::string& part) {
  models::load_state_dict(*module, parameters_of(fixture, part), models::LoadMode::kStrict,
                          fixture.name() + ".safetensors");
}

}  // namespace anigen::test
