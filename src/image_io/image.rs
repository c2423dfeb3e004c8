//! A picture in memory.

/// A picture of one or more layers of the same size, with metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The larger picture that this one is a window of; `None` where it is whole.
    pub window: Option<Window>,
    /// The layers, in order of writing. A file that was read has them in the order of their names.
    pub layers: Vec<Layer>,
    /// Names and values of what else the file says.
    pub metadata: Vec<(String, MetadataValue)>,
    /// What was odd about a file that was read, in words.
    pub findings: Vec<String>,
}

/// Where in a larger picture a picture has its place: what a crop window rendered, which viewers show at that place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Column of the larger picture that is the first here.
    pub x: i64,
    /// Row of the larger picture that is the first here.
    pub y: i64,
    /// Pixels in a row of the larger picture.
    pub full_width: u32,
    /// Its rows.
    pub full_height: u32,
}

impl Image {
    /// A picture without layers or metadata.
    #[must_use]
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height, window: None, layers: Vec::new(), metadata: Vec::new(), findings: Vec::new() }
    }

    /// The layer of this name; the picture proper has the empty name.
    #[must_use]
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.name == name)
    }

    /// The metadata of this name.
    #[must_use]
    pub fn metadata(&self, name: &str) -> Option<&MetadataValue> {
        self.metadata.iter().find(|(key, _)| key == name).map(|(_, value)| value)
    }

    /// Number of pixels.
    #[must_use]
    pub const fn pixel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// Some channels of a picture that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Its name, empty for the picture proper. In a file its channels are called `name.channel`.
    pub name: String,
    /// Names of the channels: `R`, `G`, `B` for a colour, `X`, `Y`, `Z` for a vector, `Z` for a depth. They have no dot.
    pub channels: Vec<String>,
    /// Row by row from the top, from left to right, the channels of a pixel side by side: channel `c` at column `x` of row
    /// `y` is `data[(y * width + x) * channels.len() + c]`.
    pub data: Vec<f32>,
}

impl Layer {
    /// A layer with these channels.
    #[must_use]
    pub fn new(name: impl Into<String>, channels: &[&str], data: Vec<f32>) -> Self {
        Self {
            name: name.into(),
            channels: channels.iter().map(|&channel| channel.to_owned()).collect(),
            data,
        }
    }

    /// The channels of a pixel, counted row by row from the top; `None` where there is no such pixel.
    #[must_use]
    pub fn pixel(&self, index: usize) -> Option<&[f32]> {
        let count = self.channels.len();
        self.data.get(index.checked_mul(count)?..)?.get(..count)
    }

    /// Where in a pixel the channel of this name is.
    #[must_use]
    pub fn channel_index(&self, channel: &str) -> Option<usize> {
        self.channels.iter().position(|name| name == channel)
    }
}

/// What a file says of itself under some name.
#[derive(Clone, Debug, PartialEq)]
pub enum MetadataValue {
    /// Text, in any language. A value that is none of the others is read as text too.
    Text(String),
    /// A whole number of 32 bits, the most that EXR has. Counts that may outgrow it are better stored as `Double`.
    Int(i32),
    /// A number; whole ones are exact below 2^53.
    Double(f64),
}

impl From<&str> for MetadataValue {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for MetadataValue {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<i32> for MetadataValue {
    fn from(number: i32) -> Self {
        Self::Int(number)
    }
}

impl From<f32> for MetadataValue {
    fn from(number: f32) -> Self {
        Self::Double(f64::from(number))
    }
}

impl From<f64> for MetadataValue {
    fn from(number: f64) -> Self {
        Self::Double(number)
    }
}
