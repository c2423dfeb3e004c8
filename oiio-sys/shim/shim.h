/* What cardioid needs of OpenImageIO, in C. Every string is UTF-8, except that a path has whatever bytes the system takes.
 * No function throws, or keeps a pointer it was given. */
#ifndef CARDIOID_OIIO_SHIM_H
#define CARDIOID_OIIO_SHIM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/// Why a function failed.
typedef struct OiioError {
  /// `errno` where the system failed (a full disk, say), otherwise 0.
  int32_t system;
  /// What OpenImageIO says of it, NUL-terminated, cut where it is too long.
  char text[1024];
} OiioError;

/// How one number is stored in a file, or in memory.
typedef enum OiioFormat {
  OIIO_FORMAT_UINT8 = 0,
  OIIO_FORMAT_UINT16 = 1,
  OIIO_FORMAT_HALF = 2,
  OIIO_FORMAT_FLOAT = 3,
} OiioFormat;

/// What kind of value an attribute has.
typedef enum OiioAttributeKind {
  OIIO_ATTRIBUTE_TEXT = 0,
  OIIO_ATTRIBUTE_INT = 1,
  OIIO_ATTRIBUTE_DOUBLE = 2,
} OiioAttributeKind;

/// Version of the OpenImageIO that is loaded: major * 10000 + minor * 100 + patch.
int32_t oiio_version(void);

/// Description of a picture to write: its size, channels and attributes.
typedef struct OiioSpec OiioSpec;

/// A description without attributes; null where memory is out. The channels have no names yet. To be freed.
OiioSpec* oiio_spec_new(int32_t width, int32_t height, int32_t channels, OiioFormat format);
void oiio_spec_free(OiioSpec* spec);

/// Each of these returns false where memory is out or the channel does not exist.
bool oiio_spec_set_channel_name(OiioSpec* spec, int32_t channel, const char* name);
bool oiio_spec_set_text(OiioSpec* spec, const char* name, const char* value);
bool oiio_spec_set_int(OiioSpec* spec, const char* name, int32_t value);
bool oiio_spec_set_float(OiioSpec* spec, const char* name, float value);
bool oiio_spec_set_double(OiioSpec* spec, const char* name, double value);

/// Says that the picture is a window of a larger one of this size: its first pixel is that one's pixel (x, y).
void oiio_spec_set_window(OiioSpec* spec, int32_t x, int32_t y, int32_t full_width, int32_t full_height);

/// Some channels of a picture to write: rows from the top, channels interleaved, without padding.
typedef struct OiioLayer {
  const void* pixels;
  int32_t channels;
} OiioLayer;

/// Writes a picture to an open and empty file that can seek. (Of one part: OpenImageIO before 3.0 writes several only to a
/// file that it opens itself, and does not tell when the disk is full.)
///
/// `format` names the file format as OpenImageIO does ("openexr", "png"). The channels of the layers, one layer after the
/// other, are those of the description; each number is as `memory` says. On failure the file holds rubbish and `error` says
/// why. The descriptor is left open.
bool oiio_write(int descriptor, const char* format, const OiioSpec* spec, const OiioLayer* layers, int32_t layer_count,
                OiioFormat memory, OiioError* error);

/// A file open for reading. It stands at one part, at first the first.
typedef struct OiioInput OiioInput;

/// Opens a file of this format and reads no more than its header. On failure returns null and fills `error`.
OiioInput* oiio_input_open(const char* path, const char* format, OiioError* error);
void oiio_input_free(OiioInput* input);

/// Goes to a part. False where there is none of that number.
bool oiio_input_seek(OiioInput* input, int32_t part);

/// Of the part the input stands at. Depth is 1 but for volumes. A deep part has many samples a pixel.
int32_t oiio_input_width(const OiioInput* input);
int32_t oiio_input_height(const OiioInput* input);
int32_t oiio_input_depth(const OiioInput* input);
int32_t oiio_input_channels(const OiioInput* input);
/// Where the part begins in the larger picture that it is a window of, and the size of that: 0, 0 and its own size where it is whole.
int64_t oiio_input_x(const OiioInput* input);
int64_t oiio_input_y(const OiioInput* input);
int32_t oiio_input_full_width(const OiioInput* input);
int32_t oiio_input_full_height(const OiioInput* input);
bool oiio_input_is_deep(const OiioInput* input);

/// Bytes that decoding one block of the file (a tile, or a row) takes.
uint64_t oiio_input_block_bytes(const OiioInput* input);

/// Name of a channel of the part; null where there is no such channel. Valid until the input moves or is freed.
const char* oiio_input_channel_name(const OiioInput* input, int32_t channel);

/// Attributes of the part, by number. A text is valid until the next call with this input.
int32_t oiio_input_attributes(const OiioInput* input);
const char* oiio_input_attribute_name(const OiioInput* input, int32_t attribute);
OiioAttributeKind oiio_input_attribute_kind(const OiioInput* input, int32_t attribute);
/// The value as text, whatever its kind; null where there is no such attribute.
const char* oiio_input_attribute_text(OiioInput* input, int32_t attribute);
int32_t oiio_input_attribute_int(const OiioInput* input, int32_t attribute);
double oiio_input_attribute_double(const OiioInput* input, int32_t attribute);

/// Reads all pixels of the part: rows from the top, channels interleaved in the order of their numbers. Integers of 8 and
/// 16 bits are scaled to 0..1, integers of 32 bits (ids) are not. `length` is that of `pixels` and must be width * height *
/// channels. On failure fills `error`, and the pixels may be partly written.
bool oiio_input_read(OiioInput* input, float* pixels, size_t length, OiioError* error);

/// Texels of one level of a picture: rows from the top, without padding, four channels each.
typedef struct OiioLevel {
  const void* texels;
  int32_t width;
  int32_t height;
} OiioLevel;

/// Writes a picture of tiles and levels, the finest first, each number as `memory` says, uncompressed, to a file of this path,
/// which may exist. On failure the file holds rubbish and `error` says why.
bool oiio_tiles_write(const char* path, const OiioLevel* levels, int32_t count, OiioFormat memory, OiioError* error);

/// A picture whose tiles are read when they are looked at, and kept in a cache that all such pictures share. Everything but
/// freeing it may be done by many threads at once.
typedef struct OiioTiles OiioTiles;

/// Opens a picture, and reads no more than its headers. On failure returns null and fills `error`. The file must stay as it is.
OiioTiles* oiio_tiles_open(const char* path, OiioError* error);
void oiio_tiles_free(OiioTiles* tiles);

/// Memory that the cache may take, in units of 2^20 bytes. The tiles that each thread read last are kept in any case.
void oiio_tiles_limit(float megabytes);

/// Levels of a picture; 1 where its file has the finest alone.
int32_t oiio_tiles_levels(const OiioTiles* tiles);
/// Of a level; 0 where there is none of that number.
int32_t oiio_tiles_width(const OiioTiles* tiles, int32_t level);
int32_t oiio_tiles_height(const OiioTiles* tiles, int32_t level);
/// Whether the file is stored in tiles.
bool oiio_tiles_is_tiled(const OiioTiles* tiles);
int32_t oiio_tiles_channels(const OiioTiles* tiles);
/// Bits of a number in the file.
int32_t oiio_tiles_bits(const OiioTiles* tiles);
/// Whether the file says that its colours are linear.
bool oiio_tiles_is_linear(const OiioTiles* tiles);
/// Whether colours are multiplied by the alpha beside them.
bool oiio_tiles_is_associated(const OiioTiles* tiles);

/// Reads a window of a level, which must lie within it, as numbers of four channels for each texel, rows from the top. Integers
/// are scaled to 0..1; channels that the file does not have are left as they were. `length` is that of `texels` and must be four
/// times width times height. False where the file cannot be read; `error` then says why.
bool oiio_tiles_read(const OiioTiles* tiles, int32_t level, int32_t x, int32_t y, int32_t width, int32_t height, float* texels,
                     size_t length, OiioError* error);

#ifdef __cplusplus
}
#endif

#endif
