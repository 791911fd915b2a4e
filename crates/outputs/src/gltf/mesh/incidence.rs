//! The triangles of each vertex, all in one list: a list of its own per vertex costs a cache miss
//! per visit.

use std::ops::Range;

/// Triangles by vertex.
pub(super) struct Incidence {
    /// Numbers of triangles; a vertex that gets more than it has room for moves to the end.
    triangles: Vec<u32>,
    spans: Vec<Span>,
}

/// A vertex's part of the list.
#[derive(Clone, Copy)]
struct Span {
    start: u32,
    length: u32,
    room: u32,
}

impl Incidence {
    /// Those of all corners of `triangles`.
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut spans = vec![Span { start: 0, length: 0, room: 0 }; vertices];
        for corner in triangles.as_flattened() {
            spans[*corner as usize].room += 1;
        }
        let mut start = 0;
        for span in &mut spans {
            span.start = start;
            start += span.room;
        }
        let mut incidence = Self { triangles: vec![0; start as usize], spans };
        for (number, corners) in triangles.iter().enumerate() {
            for &corner in corners {
                incidence.push(corner, number as u32);
            }
        }
        incidence
    }

    /// The triangles of a vertex.
    pub(super) fn of(&self, vertex: u32) -> &[u32] {
        let Span { start, length, .. } = self.spans[vertex as usize];
        &self.triangles[start as usize..(start + length) as usize]
    }

    /// The triangle at a place that [`Incidence::take`] returned.
    pub(super) fn at(&self, place: usize) -> u32 {
        self.triangles[place]
    }

    /// Leaves a vertex without triangles; they stay at the places that are returned.
    pub(super) fn take(&mut self, vertex: u32) -> Range<usize> {
        let span = &mut self.spans[vertex as usize];
        let taken = span.start as usize..(span.start + span.length) as usize;
        *span = Span { length: 0, room: 0, ..*span };
        taken
    }

    /// Makes room for `more` triangles of a vertex.
    pub(super) fn reserve(&mut self, vertex: u32, more: usize) {
        let Span { start, length, room } = self.spans[vertex as usize];
        let wanted = length + more as u32;
        if wanted > room {
            let moved = self.triangles.len() as u32;
            self.triangles.extend_from_within(start as usize..(start + length) as usize);
            self.triangles.resize((moved + wanted) as usize, 0);
            self.spans[vertex as usize] = Span { start: moved, length, room: wanted };
        }
    }

    /// Adds a triangle to a vertex that has room for it.
    pub(super) fn push(&mut self, vertex: u32, triangle: u32) {
        let span = &mut self.spans[vertex as usize];
        debug_assert!(span.length < span.room, "reserve comes first");
        self.triangles[(span.start + span.length) as usize] = triangle;
        span.length += 1;
    }

    /// Removes a triangle from a vertex, if it is there.
    pub(super) fn remove(&mut self, vertex: u32, triangle: u32) {
        let Span { start, length, .. } = self.spans[vertex as usize];
        let own = &mut self.triangles[start as usize..(start + length) as usize];
        if let Some(at) = own.iter().position(|&other| other == triangle) {
            own[at..].rotate_left(1);
            self.spans[vertex as usize].length -= 1;
        }
    }
}
