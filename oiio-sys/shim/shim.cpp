#include "shim.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imagecache.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include <unistd.h>

// Not `using namespace OIIO`: it has names that collide with others.
using OIIO::ImageCache;
using OIIO::ImageInput;
using OIIO::ImageOutput;
using OIIO::ImageSpec;
using OIIO::TypeDesc;

struct OiioSpec {
  ImageSpec spec;
};

struct OiioInput {
  std::unique_ptr<ImageInput> file;
  int part = 0;
  ImageSpec spec;    // of that part
  std::string text;  // returned last
};

struct OiioTiles {
  OIIO::ustring path;
  ImageCache::ImageHandle* file;
  std::vector<ImageSpec> levels;  // as the file has them, at least one
};

namespace {

/// Texels along a side of the tiles that are written.
constexpr int TILE = 64;

/// The cache of all pictures that are read by tiles. It lives as long as the process.
ImageCache& tile_cache()
{
  // A pointer, or from OpenImageIO 3.0 on a shared one.
  static const auto cache = [] {
    auto made = ImageCache::create(false);
    // Values as they stand in the file, not multiplied by its alpha.
    made->attribute("unassociatedalpha", 1);
    // A file that cannot be read is told once, with all there is to tell.
    made->attribute("failure_retries", 0);
    return made;
  }();
  return *cache;
}

TypeDesc type_of(OiioFormat format)
{
  switch (format) {
    case OIIO_FORMAT_UINT8: return TypeDesc::UINT8;
    case OIIO_FORMAT_UINT16: return TypeDesc::UINT16;
    case OIIO_FORMAT_HALF: return TypeDesc::HALF;
    case OIIO_FORMAT_FLOAT: return TypeDesc::FLOAT;
  }
  return TypeDesc::UNKNOWN;
}

void describe(OiioError* error, int system, const std::string& text)
{
  error->system = system;
  const size_t length = std::min(text.size(), sizeof error->text - 1);
  std::memcpy(error->text, text.data(), length);
  error->text[length] = '\0';
}

/// Calls a function; an exception becomes `failure`, and is described where somebody wants to know.
template<typename Result, typename Function> Result guard(Result failure, OiioError* error, Function function) noexcept
{
  try {
    return function();
  } catch (const std::bad_alloc&) {
    if (error) describe(error, ENOMEM, "out of memory");
  } catch (const std::exception& exception) {
    if (error) describe(error, 0, exception.what());
  } catch (...) {
    if (error) describe(error, 0, "unknown exception");
  }
  return failure;
}

/// Keeps the library from printing what only its authors want to know, which distributions' builds do.
void be_quiet()
{
  static const bool done = OIIO::attribute("debug", 0);
  (void)done;
}

/// A file that the caller opened, and that remembers the first error of the system: OpenImageIO's writers do not all tell.
class Descriptor final : public OIIO::Filesystem::IOProxy {
public:
  explicit Descriptor(int descriptor) : IOProxy("", Write), m_descriptor(descriptor) {}

  const char* proxytype() const override { return "descriptor"; }

  size_t write(const void* data, size_t size) override
  {
    const size_t written = pwrite(data, size, m_pos);
    m_pos += written;
    return written;
  }

  size_t pwrite(const void* data, size_t size, int64_t offset) override
  {
    size_t written = 0;
    while (written < size && m_failure == 0) {
      const ssize_t step = ::pwrite(m_descriptor, static_cast<const char*>(data) + written, size - written,
                                    offset + static_cast<int64_t>(written));
      if (step >= 0)
        written += static_cast<size_t>(step);
      else if (errno != EINTR)
        m_failure = errno;
    }
    m_size = std::max(m_size, static_cast<size_t>(offset) + written);
    return written;
  }

  bool seek(int64_t offset) override
  {
    m_pos = offset;
    return true;
  }

  size_t size() const override { return m_size; }

  int failure() const { return m_failure; }

private:
  int m_descriptor;
  int m_failure = 0;
  size_t m_size = 0;
};

/// Writes an open picture strip by strip, so that the layers need never lie interleaved in memory as a whole.
bool write_strips(ImageOutput& output, const ImageSpec& spec, const OiioLayer* layers, int32_t layer_count,
                  TypeDesc memory)
{
  constexpr int STRIP_ROWS = 64;  // several blocks of each compression but one, so that they are compressed in parallel
  const size_t pixel_bytes = memory.size() * static_cast<size_t>(spec.nchannels);
  std::vector<char> strip(pixel_bytes * static_cast<size_t>(spec.width) * std::min(spec.height, STRIP_ROWS));
  for (int y = 0; y < spec.height; y += STRIP_ROWS) {
    const int end = std::min(y + STRIP_ROWS, spec.height);
    const size_t first = static_cast<size_t>(y) * spec.width;
    const size_t count = static_cast<size_t>(end - y) * spec.width;
    char* destination = strip.data();
    for (const OiioLayer* layer = layers; layer != layers + layer_count; ++layer) {
      const size_t bytes = memory.size() * static_cast<size_t>(layer->channels);
      const char* source = static_cast<const char*>(layer->pixels) + first * bytes;
      for (size_t i = 0; i < count; ++i) std::memcpy(destination + i * pixel_bytes, source + i * bytes, bytes);
      destination += bytes;
    }
    if (!output.write_scanlines(spec.y + y, spec.y + end, 0, memory, strip.data())) return false;
  }
  return true;
}

const OIIO::ParamValue* attribute_of(const OiioInput* input, int32_t attribute)
{
  const auto& all = input->spec.extra_attribs;
  return attribute >= 0 && static_cast<size_t>(attribute) < all.size() ? &all[attribute] : nullptr;
}

/// 32-bit integers are ids, not fractions of the largest integer: read them again, as they are.
bool reread_integers(OiioInput* input, float* pixels)
{
  const int channels = input->spec.nchannels;
  const size_t count = static_cast<size_t>(input->spec.image_pixels());
  std::vector<uint32_t> plane;
  for (int channel = 0; channel < channels; ++channel) {
    if (input->spec.channelformat(channel) != TypeDesc::UINT32) continue;
    plane.resize(count);
    if (!input->file->read_image(input->part, 0, channel, channel + 1, TypeDesc::UINT32, plane.data())) return false;
    for (size_t i = 0; i < count; ++i) pixels[i * channels + channel] = static_cast<float>(plane[i]);
  }
  return true;
}

}  // namespace

int32_t oiio_version(void)
{
  return OIIO::openimageio_version();
}

OiioSpec* oiio_spec_new(int32_t width, int32_t height, int32_t channels, OiioFormat format)
{
  return guard<OiioSpec*>(nullptr, nullptr,
                          [&] { return new OiioSpec{ImageSpec(width, height, channels, type_of(format))}; });
}

void oiio_spec_free(OiioSpec* spec)
{
  delete spec;
}

bool oiio_spec_set_channel_name(OiioSpec* spec, int32_t channel, const char* name)
{
  return guard(false, nullptr, [&] {
    spec->spec.channelnames.at(static_cast<size_t>(channel)) = name;
    return true;
  });
}

bool oiio_spec_set_text(OiioSpec* spec, const char* name, const char* value)
{
  return guard(false, nullptr, [&] {
    spec->spec.attribute(name, value);
    return true;
  });
}

bool oiio_spec_set_int(OiioSpec* spec, const char* name, int32_t value)
{
  return guard(false, nullptr, [&] {
    spec->spec.attribute(name, value);
    return true;
  });
}

bool oiio_spec_set_float(OiioSpec* spec, const char* name, float value)
{
  return guard(false, nullptr, [&] {
    spec->spec.attribute(name, value);
    return true;
  });
}

bool oiio_spec_set_double(OiioSpec* spec, const char* name, double value)
{
  return guard(false, nullptr, [&] {
    spec->spec.attribute(name, TypeDesc::DOUBLE, &value);
    return true;
  });
}

void oiio_spec_set_window(OiioSpec* spec, int32_t x, int32_t y, int32_t full_width, int32_t full_height)
{
  spec->spec.x = x;
  spec->spec.y = y;
  spec->spec.full_x = 0;
  spec->spec.full_y = 0;
  spec->spec.full_width = full_width;
  spec->spec.full_height = full_height;
}

bool oiio_write(int descriptor, const char* format, const OiioSpec* spec, const OiioLayer* layers, int32_t layer_count,
                OiioFormat memory, OiioError* error)
{
  return guard(false, error, [&] {
    be_quiet();
    // Outlives the output, which may write when it is destroyed.
    Descriptor file(descriptor);
    const auto output = ImageOutput::create(format);
    if (!output) {
      describe(error, 0, OIIO::geterror());
      return false;
    }
    if (!output->set_ioproxy(&file)) {
      describe(error, 0, std::string(format) + " cannot be written to an open file");
      return false;
    }
    const bool written = output->open(format, spec->spec) &&
                         write_strips(*output, spec->spec, layers, layer_count, type_of(memory)) && output->close();
    if (file.failure() != 0) {
      describe(error, file.failure(), std::strerror(file.failure()));
      return false;
    }
    if (!written) describe(error, 0, output->geterror());
    return written;
  });
}

OiioInput* oiio_input_open(const char* path, const char* format, OiioError* error)
{
  return guard<OiioInput*>(nullptr, error, [&]() -> OiioInput* {
    be_quiet();
    auto input = std::make_unique<OiioInput>();
    input->file = ImageInput::create(format);
    if (!input->file) {
      describe(error, 0, OIIO::geterror());
      return nullptr;
    }
    ImageSpec options;
    // The values as they stand in the file, not multiplied by its alpha.
    options.attribute("oiio:UnassociatedAlpha", 1);
    if (!input->file->open(path, input->spec, options)) {
      describe(error, 0, input->file->geterror());
      return nullptr;
    }
    return input.release();
  });
}

void oiio_input_free(OiioInput* input)
{
  guard(false, nullptr, [&] {
    delete input;
    return true;
  });
}

bool oiio_input_seek(OiioInput* input, int32_t part)
{
  return guard(false, nullptr, [&] {
    if (!input->file->seek_subimage(part, 0)) {
      input->file->geterror();  // read, so that it does not turn up as the reason of a later failure
      return false;
    }
    input->part = part;
    input->spec = input->file->spec();
    return true;
  });
}

int32_t oiio_input_width(const OiioInput* input)
{
  return input->spec.width;
}

int32_t oiio_input_height(const OiioInput* input)
{
  return input->spec.height;
}

int64_t oiio_input_x(const OiioInput* input)
{
  return int64_t{input->spec.x} - input->spec.full_x;
}

int64_t oiio_input_y(const OiioInput* input)
{
  return int64_t{input->spec.y} - input->spec.full_y;
}

int32_t oiio_input_full_width(const OiioInput* input)
{
  return input->spec.full_width;
}

int32_t oiio_input_full_height(const OiioInput* input)
{
  return input->spec.full_height;
}

int32_t oiio_input_depth(const OiioInput* input)
{
  return input->spec.depth;
}

int32_t oiio_input_channels(const OiioInput* input)
{
  return input->spec.nchannels;
}

bool oiio_input_is_deep(const OiioInput* input)
{
  return input->spec.deep;
}

uint64_t oiio_input_block_bytes(const OiioInput* input)
{
  return input->spec.tile_width > 0 ? input->spec.tile_bytes(true) : input->spec.scanline_bytes(true);
}

const char* oiio_input_channel_name(const OiioInput* input, int32_t channel)
{
  const auto& names = input->spec.channelnames;
  return channel >= 0 && static_cast<size_t>(channel) < names.size() ? names[channel].c_str() : nullptr;
}

int32_t oiio_input_attributes(const OiioInput* input)
{
  return static_cast<int32_t>(input->spec.extra_attribs.size());
}

const char* oiio_input_attribute_name(const OiioInput* input, int32_t attribute)
{
  const auto* value = attribute_of(input, attribute);
  return value ? value->name().c_str() : nullptr;
}

OiioAttributeKind oiio_input_attribute_kind(const OiioInput* input, int32_t attribute)
{
  const auto* value = attribute_of(input, attribute);
  if (value && value->type() == TypeDesc(TypeDesc::INT)) return OIIO_ATTRIBUTE_INT;
  if (value && (value->type() == TypeDesc(TypeDesc::FLOAT) || value->type() == TypeDesc(TypeDesc::DOUBLE)))
    return OIIO_ATTRIBUTE_DOUBLE;
  return OIIO_ATTRIBUTE_TEXT;
}

const char* oiio_input_attribute_text(OiioInput* input, int32_t attribute)
{
  return guard<const char*>(nullptr, nullptr, [&]() -> const char* {
    const auto* value = attribute_of(input, attribute);
    if (!value) return nullptr;
    input->text = value->get_string();
    return input->text.c_str();
  });
}

int32_t oiio_input_attribute_int(const OiioInput* input, int32_t attribute)
{
  const auto* value = attribute_of(input, attribute);
  return value ? guard(0, nullptr, [&] { return value->get_int(); }) : 0;
}

double oiio_input_attribute_double(const OiioInput* input, int32_t attribute)
{
  const auto* value = attribute_of(input, attribute);
  if (!value) return std::numeric_limits<double>::quiet_NaN();
  // get_float would round a double.
  if (value->type() == TypeDesc(TypeDesc::DOUBLE)) return *static_cast<const double*>(value->data());
  return guard(0.0f, nullptr, [&] { return value->get_float(); });
}

bool oiio_input_read(OiioInput* input, float* pixels, size_t length, OiioError* error)
{
  return guard(false, error, [&] {
    if (length != static_cast<size_t>(input->spec.image_pixels()) * input->spec.nchannels) {
      describe(error, 0, "buffer of the wrong size");
      return false;
    }
    const bool read = input->file->read_image(input->part, 0, 0, -1, TypeDesc::FLOAT, pixels) &&
                      reread_integers(input, pixels);
    if (!read) describe(error, 0, input->file->geterror());
    return read;
  });
}

bool oiio_tiles_write(const char* path, const OiioLevel* levels, int32_t count, OiioFormat memory, OiioError* error)
{
  return guard(false, error, [&] {
    be_quiet();
    const auto output = ImageOutput::create("tiff");
    if (!output) {
      describe(error, 0, OIIO::geterror());
      return false;
    }
    for (int32_t i = 0; i < count; ++i) {
      ImageSpec spec(levels[i].width, levels[i].height, 4, type_of(memory));
      spec.tile_width = spec.tile_height = TILE;
      spec.alpha_channel = -1;  // no channel means anything to the writer
      spec.attribute("compression", "none");
      spec.attribute("tiff:bigtiff", 1);
      // By this, the reader takes the parts of the file for levels.
      spec.attribute("textureformat", "Plain Texture");
      errno = 0;
      const auto mode = i == 0 ? ImageOutput::Create : ImageOutput::AppendSubimage;
      if (!output->open(path, spec, mode) || !output->write_image(type_of(memory), levels[i].texels)) {
        describe(error, errno, output->geterror());
        return false;
      }
    }
    if (!output->close()) {
      describe(error, errno, output->geterror());
      return false;
    }
    return true;
  });
}

OiioTiles* oiio_tiles_open(const char* path, OiioError* error)
{
  return guard<OiioTiles*>(nullptr, error, [&]() -> OiioTiles* {
    be_quiet();
    ImageCache& cache = tile_cache();
    auto tiles = std::make_unique<OiioTiles>();
    tiles->path = OIIO::ustring(path);
    // What an earlier file of this name left.
    cache.invalidate(tiles->path);
    tiles->file = cache.get_image_handle(tiles->path);
    if (!tiles->file || !cache.good(tiles->file)) {
      describe(error, 0, cache.geterror());
      return nullptr;
    }
    for (int level = 0;; ++level) {
      ImageSpec spec;
#if OIIO_VERSION >= 30000
      const bool found = cache.get_cache_dimensions(tiles->file, nullptr, spec, 0, level);
#else
      const bool found = cache.get_imagespec(tiles->file, nullptr, spec, 0, level, true);
#endif
      if (!found) break;
      tiles->levels.push_back(spec);
    }
    const std::string last = cache.geterror();  // of the level that is not there, or of the first
    if (tiles->levels.empty()) {
      describe(error, 0, last);
      return nullptr;
    }
    return tiles.release();
  });
}

void oiio_tiles_free(OiioTiles* tiles)
{
  guard(false, nullptr, [&] {
    tile_cache().invalidate(tiles->path);
    delete tiles;
    return true;
  });
}

void oiio_tiles_limit(float megabytes)
{
  guard(false, nullptr, [&] { return tile_cache().attribute("max_memory_MB", megabytes); });
}

int32_t oiio_tiles_levels(const OiioTiles* tiles)
{
  return static_cast<int32_t>(tiles->levels.size());
}

int32_t oiio_tiles_width(const OiioTiles* tiles, int32_t level)
{
  return level >= 0 && level < oiio_tiles_levels(tiles) ? tiles->levels[level].width : 0;
}

int32_t oiio_tiles_height(const OiioTiles* tiles, int32_t level)
{
  return level >= 0 && level < oiio_tiles_levels(tiles) ? tiles->levels[level].height : 0;
}

bool oiio_tiles_is_tiled(const OiioTiles* tiles)
{
  // Larger ones are no tiles to read one at a time.
  constexpr int LARGEST = 2048;
  const ImageSpec& spec = tiles->levels[0];
  return spec.tile_width > 0 && spec.tile_width <= LARGEST && spec.tile_height > 0 && spec.tile_height <= LARGEST;
}

int32_t oiio_tiles_channels(const OiioTiles* tiles)
{
  return tiles->levels[0].nchannels;
}

int32_t oiio_tiles_bits(const OiioTiles* tiles)
{
  return static_cast<int32_t>(8 * tiles->levels[0].format.basesize());
}

bool oiio_tiles_is_linear(const OiioTiles* tiles)
{
  return guard(false, nullptr, [&] {
    const std::string space = tiles->levels[0].get_string_attribute("oiio:ColorSpace");
    const auto is = [&](const char* name) { return OIIO::Strutil::iequals(space, name); };
    return is("linear") || is("lin_srgb") || is("lin_rec709") || is("lin_rec709_scene") || is("scene_linear");
  });
}

bool oiio_tiles_is_associated(const OiioTiles* tiles)
{
  return guard(false, nullptr, [&] {
    const ImageSpec& spec = tiles->levels[0];
    return spec.alpha_channel >= 0 && spec.get_int_attribute("oiio:UnassociatedAlpha", 0) == 0;
  });
}

bool oiio_tiles_read(const OiioTiles* tiles, int32_t level, int32_t x, int32_t y, int32_t width, int32_t height, float* texels,
                     size_t length, OiioError* error)
{
  return guard(false, error, [&] {
    const bool is_within = x >= 0 && y >= 0 && width > 0 && height > 0 && x + width <= oiio_tiles_width(tiles, level) &&
                           y + height <= oiio_tiles_height(tiles, level);
    if (!is_within || length != 4 * static_cast<size_t>(width) * static_cast<size_t>(height)) {
      describe(error, 0, "no such texels");
      return false;
    }
    const ImageSpec& spec = tiles->levels[level];
    const int left = spec.x + x, top = spec.y + y;
    const OIIO::stride_t texel = 4 * sizeof(float);
    ImageCache& cache = tile_cache();
    const bool read = cache.get_pixels(tiles->file, nullptr, 0, level, left, left + width, top, top + height, spec.z, spec.z + 1, 0,
                                       std::min(spec.nchannels, 4), TypeDesc::FLOAT, texels, texel, texel * width);
    if (!read) describe(error, 0, cache.geterror());
    return read;
  });
}
