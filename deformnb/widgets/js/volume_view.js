// The volume view: pictures that Python draws. Joined behind the files that deformnb/widgets/view/volume_view.py names.

function render({ model, el }) { return opened(new PicturesPage(model, el)); }

export default { render };
