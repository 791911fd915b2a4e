//! Zip files, for targets that get what is in them.

/// A zip file of stored entries.
pub fn archive(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::<u8>::new(), Vec::<u8>::new());
    for (name, content) in entries {
        let start = bytes.len() as u32;
        let (sum, length) = (crc32fast::hash(content), content.len() as u32);
        let mut fields = vec![20, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        for number in [sum, length, length] {
            fields.extend(number.to_le_bytes());
        }
        fields.extend((name.len() as u16).to_le_bytes());
        fields.extend([0; 2]);
        for part in [b"PK\x03\x04", &fields[..], name.as_bytes(), content] {
            bytes.extend(part);
        }
        for part in
            [b"PK\x01\x02\x14\x00", &fields[..], &[0; 10], &start.to_le_bytes(), name.as_bytes()]
        {
            directory.extend(part);
        }
    }
    let count = (entries.len() as u16).to_le_bytes();
    let start = bytes.len() as u32;
    let length = directory.len() as u32;
    bytes.extend(directory);
    for part in [
        b"PK\x05\x06\0\0\0\0",
        &count[..],
        &count,
        &length.to_le_bytes(),
        &start.to_le_bytes(),
        &[0; 2],
    ] {
        bytes.extend(part);
    }
    bytes
}
