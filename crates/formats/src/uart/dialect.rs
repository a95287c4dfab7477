//! The dialects of TI's UART output: layout of the packet header, and definition of the TLV length.

/// A family of firmware versions with the same packet framing. All are little-endian and start with [`super::MAGIC`].
///
/// | dialect | header | TLV length field | source |
/// |---|---|---|---|
/// | [`Sdk3`](Self::Sdk3) | 40 bytes | excludes its own 8 bytes | a recorded stream |
/// | [`AreaScanner`](Self::AreaScanner) | 44 bytes | excludes them | public parsers; not tested with a recording |
/// | [`PeopleCounting3d`](Self::PeopleCounting3d) | 48 bytes, checksum | includes them | public parsers; not tested with a recording |
/// | [`PeopleCounting2d`](Self::PeopleCounting2d), [`PeopleCounting2dCompact`](Self::PeopleCounting2dCompact) | 52 bytes, checksum | includes them | public parsers; not tested with a recording |
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Dialect {
    /// Out-of-box demo of mmWave SDK 3 and the labs of the Radar Toolbox. They are one dialect because the framing is
    /// the same, and the TLV types of the Toolbox (from 300 on) differ from those of the demo (1 to 9).
    Sdk3,
    /// Area Scanner lab: one additional header field (static points), and spherical points in type 1.
    AreaScanner,
    /// 3D People Counting of the Industrial Toolbox 4.7: types 6, 7 and 8 are points, targets and indices.
    PeopleCounting3d,
    /// 2D people counting of the xWR16xx: type 6 contains 4 floats per point.
    PeopleCounting2d,
    /// 2D people counting of the xWR68xx: type 6 contains the units, followed by 6 bytes per point.
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

    /// The dialect with the given [`Self::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|d| d.name() == name)
    }

    /// Number of bytes from the magic to the first TLV.
    pub fn header_len(self) -> usize {
        match self {
            Self::Sdk3 => 40,
            Self::AreaScanner => 44,
            Self::PeopleCounting3d => 48,
            Self::PeopleCounting2d | Self::PeopleCounting2dCompact => 52,
        }
    }

    /// Whether the length field of a TLV includes the 8 bytes of type and length.
    pub fn tlv_length_includes_header(self) -> bool {
        !matches!(self, Self::Sdk3 | Self::AreaScanner)
    }

    /// Whether the 16-bit words of the header must sum to 0xFFFF with end-around carry.
    pub fn has_checksum(self) -> bool {
        self.tlv_length_includes_header()
    }
}
