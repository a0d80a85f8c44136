#include "anigen/rig/binding/strongest_influences.h"

#include <algorithm>

namespace anigen::rig {

StrongestInfluences::StrongestInfluences(std::size_t rows, std::size_t joints, std::size_t most)
    : most_(most == 0 ? joints : std::min(most, joints)), counts_(rows, 0), kept_(rows * most_) {}

void StrongestInfluences::offer(std::size_t row, std::size_t joint, float weight) {
  if (!(weight > 0.0F)) return;
  const Influence offered{static_cast<std::int32_t>(joint), weight};
  const auto stronger = [](const Influence& a, const Influence& b) {
    return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
  };
  Influence* first = kept_.data() + row * most_;
  std::uint32_t& count = counts_[row];
  if (count == most_) {
    if (!stronger(offered, first[count - 1])) return;
  } else {
    ++count;
  }
  Influence* place = first + count - 1;
  for (; place != first && stronger(offered, place[-1]); --place) *place = place[-1];
  *place = offered;
}

SkinWeights StrongestInfluences::rows() const {
  SkinWeights skin;
  skin.offsets.reserve(counts_.size() + 1);
  for (std::size_t row = 0; row < counts_.size(); ++row) {
    const Influence* first = kept_.data() + row * most_;
    skin.append_row({first, first + counts_[row]});
  }
  return skin;
}

}  // namespace anigen::rig
