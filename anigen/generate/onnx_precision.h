#pragma once
#include <string>

namespace anigen::generate {

/// An ONNX network in the form that OpenCV 4.6 reads: weights and constants of 16-bit floats become 32-bit ones, casts
/// between float types become identities, inputs and outputs are declared as 32-bit floats, and nodes stand in an order
/// in which each follows those it needs. Everything else keeps its bytes.
/// @param model bytes of a ModelProto (onnx.proto3 of ONNX 1.x) @param name of the file, for messages
/// @throws InputError when the bytes are no ONNX network, its nodes depend on each other in a ring, or it keeps weights
/// in other files
std::string in_full_precision(const std::string& model, const std::string& name);

}  // namespace anigen::generate
