#pragma once

namespace anigen::io {

/// Loads the module that calls OpenCV for pictures and captions, `anigen-opencv.so` (core/module_file.h), on the first
/// call, and looks up a function in it: OpenCV's decoders bring 140 libraries along, which take a tenth of a second to
/// load, and most work needs none of them.
/// @return null where there is no such module, as in lean builds @throws Error naming the file when it cannot be loaded
void* opencv_module_entry(const char* function);

}  // namespace anigen::io
