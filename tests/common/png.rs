//! PNG files made by hand, and damaged ones whose checksums fit: a decoder looks behind those.

/// A PNG of `width` x `height` px, each one byte of an index into `palette` and its `opacity`,
/// which may be any bytes.
pub(crate) fn indexed(width: u32, height: u32, palette: &[u8], opacity: &[u8]) -> Vec<u8> {
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, 3, 0, 0, 0]].concat();
    let row = |y: u32| std::iter::once(0).chain((0..width).map(move |x| ((x + y) % 4) as u8));
    let rows: Vec<u8> = (0..height).flat_map(row).collect();
    // One stored block of deflate, which holds up to 65,535 bytes.
    let length = u16::try_from(rows.len()).expect("a small picture");
    let block = [&[0x78, 1, 1][..], &length.to_le_bytes(), &(!length).to_le_bytes(), &rows];
    let data = [&block.concat()[..], &adler32(&rows).to_be_bytes()].concat();
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    let chunks = [
        (b"IHDR", &header[..]),
        (b"PLTE", palette),
        (b"tRNS", opacity),
        (b"IDAT", &data),
        (b"IEND", &[]),
    ];
    for (name, data) in
        chunks.into_iter().filter(|(name, data)| *name != b"tRNS" || !data.is_empty())
    {
        png.extend((data.len() as u32).to_be_bytes());
        png.extend([&name[..], data].concat());
        png.extend([0; 4]);
    }
    with_checksums(&png)
}

/// The same bytes with the checksum of every whole chunk put right; what is no PNG stays as it is.
pub(crate) fn with_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut fixed = bytes.to_vec();
    let mut at = 8;
    while bytes.starts_with(b"\x89PNG") && at + 12 <= bytes.len() {
        let len =
            u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]) as usize;
        let end = at.saturating_add(8).saturating_add(len);
        if end + 4 > bytes.len() {
            break;
        }
        fixed[end..end + 4].copy_from_slice(&crc32(&bytes[at + 4..end]).to_be_bytes());
        at = end + 4;
    }
    fixed
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

fn adler32(bytes: &[u8]) -> u32 {
    let (a, b) = bytes.iter().fold((1u32, 0u32), |(a, b), byte| {
        let a = (a + u32::from(*byte)) % 65_521;
        (a, (b + a) % 65_521)
    });
    b << 16 | a
}
