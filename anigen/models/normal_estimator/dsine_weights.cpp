#include "anigen/models/normal_estimator/dsine_weights.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "anigen/io/torch_archive.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/models/weight_checks.h"

namespace anigen::models {
namespace {

constexpr std::string_view kStateDict = "model.", kParallel = "module.", kCounter = ".num_batches_tracked";

bool begins_with(const std::string& key, std::string_view start) { return key.compare(0, start.size(), start) == 0; }

bool is_counter(const std::string& key) {
  return key.size() > kCounter.size() && key.compare(key.size() - kCounter.size(), kCounter.size(), kCounter) == 0;
}

// The state dict under its released keys, without the counters.
io::NamedArrays released_keys(io::NamedArrays arrays) {
  const bool nested =
      std::any_of(arrays.begin(), arrays.end(), [](const auto& entry) { return begins_with(entry.first, kStateDict); });
  io::NamedArrays state;
  for (auto& [key, array] : arrays) {
    if (nested && !begins_with(key, kStateDict)) continue;
    if (nested) key.erase(0, kStateDict.size());
    if (begins_with(key, kParallel)) key.erase(0, kParallel.size());
    if (!is_counter(key)) state.emplace_back(std::move(key), std::move(array));
  }
  return state;
}

}  // namespace

void set_dsine_weights(Dsine& network, io::NamedArrays arrays, const std::string& file) {
  io::NamedArrays state = released_keys(std::move(arrays));
  check_weight_values(state, file);
  for (const StateEntry& entry : state_entries(*network)) {
    if (is_counter(entry.key)) state.emplace_back(entry.key, to_array(entry.tensor));
  }
  load_state_dict(*network, state, LoadMode::kStrict, file);
}

Dsine load_dsine(const std::filesystem::path& file) {
  Dsine network;
  set_dsine_weights(network, io::read_state_dict(file), file.string());
  return network;
}

}  // namespace anigen::models
