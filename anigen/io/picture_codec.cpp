#include "anigen/io/picture_codec.h"

#include "anigen/io/opencv_module.h"

namespace anigen::io {

const PictureCodec* opencv_codec() {
  using Entry = const PictureCodec* (*)();
  static const auto entry = reinterpret_cast<Entry>(opencv_module_entry("anigen_opencv_codec"));
  return entry == nullptr ? nullptr : entry();
}

const PictureCodec& picture_codec() {
  static const PictureCodec* const by_opencv = opencv_codec();
  return by_opencv == nullptr ? stb_codec() : *by_opencv;
}

}  // namespace anigen::io
