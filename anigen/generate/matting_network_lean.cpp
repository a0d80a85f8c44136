#include "anigen/core/error.h"
#include "anigen/generate/matting_network.h"

namespace anigen::generate {

struct MattingNetwork::Loaded {};

MattingNetwork::MattingNetwork(const MattingOptions& options) {
  throw NotSupportedError(options.network.string(), "",
                          "an ONNX network in a build without OpenCV; name a trained run, such as the shipped one");
}

MattingNetwork::~MattingNetwork() = default;

std::vector<std::uint8_t> MattingNetwork::mask(const io::Image&) { return {}; }

}  // namespace anigen::generate
