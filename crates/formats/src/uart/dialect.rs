//! The dialects of TI's UART output: layout of the packet header, and definition of the TLV length.

/// A family of firmware that frames its packets in one way. All are little-endian and start with [`super::MAGIC`].
///
/// | dialect | header | length field of a TLV | known from |
/// |---|---|---|---|
/// | [`Sdk3`](Self::Sdk3) | 40 bytes | without its own 8 bytes | a recorded stream |
/// | [`AreaScanner`](Self::AreaScanner) | 44 bytes | without | public parsers; not tested with a recording |
/// | [`PeopleCounting3d`](Self::PeopleCounting3d) | 48 bytes, checksum | with | public parsers; not tested with a recording |
/// | [`PeopleCounting2d`](Self::PeopleCounting2d), [`PeopleCounting2dCompact`](Self::PeopleCounting2dCompact) | 52 bytes, checksum | with | public parsers; not tested with a recording |
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Dialect {
    /// mmWave SDK 3 out-of-box demo and the labs of the Radar Toolbox. One dialect: the framing is the same, and the
    /// Toolbox's numbers (from 300 on) do not collide with the demo's (1 to 9).
    Sdk3,
    /// Area Scanner lab: one more field in the header (static points), spherical points in type 1.
    AreaScanner,
    /// 3D People Counting of the Industrial Toolbox 4.7: types 6, 7, 8 are points, targets, indices.
    PeopleCounting3d,
    /// 2D people counting of the xWR16xx: type 6 holds 4 floats a point.
    PeopleCounting2d,
    /// 2D people counting of the xWR68xx: type 6 holds units, then 6 bytes a point.
    PeopleCounting2dCompact,
}

impl Dialect {
    /// All dialects.
    pub const ALL: [Self; 5] = [
        Self::Sdk3,
        Self::AreaScanner,
        Self::PeopleCounting3d,
        Self::PeopleCounting2d,
        Self::PeopleCounting2dCompact,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sdk3 => "sdk3",
            Self::AreaScanner => "area-scanner",
            Self::PeopleCounting3d => "people-3d",
            Self::PeopleCounting2d => "people-2d",
            Self::PeopleCounting2dCompact => "people-2d-compact",
        }
    }

    /// The dialect of that [`Self::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|d| d.name() == name)
    }

    /// Bytes from the magic to the first TLV.
    pub fn header_len(self) -> usize {
        match self {
            Self::Sdk3 => 40,
            Self::AreaScanner => 44,
            Self::PeopleCounting3d => 48,
            Self::PeopleCounting2d | Self::PeopleCounting2dCompact => 52,
        }
    }

    /// True when the length field of a TLV counts the 8 bytes of type and length.
    pub fn tlv_length_includes_header(self) -> bool {
        !matches!(self, Self::Sdk3 | Self::AreaScanner)
    }

    /// True when the 16-bit words of the header must sum to 0xFFFF with end-around carry.
    pub fn has_checksum(self) -> bool {
        self.tlv_length_includes_header()
    }
}
